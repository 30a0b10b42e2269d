"""Studies of the methods: accuracy, speed, the paper's experiments, visual odometry, and rivals to compare with."""

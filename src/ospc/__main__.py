"""``python -m ospc``: the command, where its script is not on the search path."""

from ospc.cli.main import main

if __name__ == "__main__":
    main()

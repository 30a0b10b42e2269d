"""The paper's figures and tables as functions: a recording with truth comes in, rows and pictures go out."""

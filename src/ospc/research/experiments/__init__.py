"""The paper's figures and tables, and related experiments."""

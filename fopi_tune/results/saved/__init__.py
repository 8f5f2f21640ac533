"""Results as files:  what the command line writes, and reading it again."""

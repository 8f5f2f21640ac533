"""`python -m fopi_tune`: the command `fopi`."""

from fopi_tune.cli import main

if __name__ == "__main__":
    main()

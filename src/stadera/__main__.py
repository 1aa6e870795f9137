"""`python -m stadera` is the command `stadera`."""

from stadera.cli import main

if __name__ == "__main__":
    main()

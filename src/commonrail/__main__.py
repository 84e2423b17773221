"""``python -m commonrail``: the command, if its script is not on the path."""

from commonrail.cli.start import main

if __name__ == "__main__":
    main()

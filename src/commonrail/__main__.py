"""``python -m commonrail``: the command where no script of that name is on the path."""

from commonrail.cli.start import main

if __name__ == "__main__":
    main()

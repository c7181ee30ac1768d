"""``python -m vffnull`` is the command ``vffnull``."""

from vffnull.cli import main

if __name__ == "__main__":
    main()

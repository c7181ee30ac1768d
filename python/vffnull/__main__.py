"""``python -m vffnull`` is the command ``vffnull``."""

from vffnull_command import main

if __name__ == "__main__":
    main()

"""`python -m exosight` is the command `exosight`."""

from exosight.app.main import main

if __name__ == "__main__":
    main()

"""exosight: contact forces of a soft finger exosuit from a plain camera image."""

__version__ = "0.1.0"

"""What the documentation says about speed, measured again by one command."""

"""One module a verb of the command line: its options, and the function that they feed."""

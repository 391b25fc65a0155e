"""What was proved of closures, in files: what each kind holds, what is refused, written and read."""

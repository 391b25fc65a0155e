"""What is proved of control laws: `set_point` and `tracking`, which share nothing but the bounds below them."""

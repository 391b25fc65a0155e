"""How a mechanism can move at a closed pose: rank and mobility, idle motions, and which joints measure and drive it."""

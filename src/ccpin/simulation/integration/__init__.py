"""One motion integrated: step by step, from event to event, in coordinates that are exchanged, or in the core."""

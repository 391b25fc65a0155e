"""The same mechanism in other coordinates: others independent, or balls for three revolutes that are one."""

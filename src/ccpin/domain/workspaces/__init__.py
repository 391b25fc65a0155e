"""Where an end effector gets to: certified workspaces, the largest cube or ball in one, and lengths of links for it."""

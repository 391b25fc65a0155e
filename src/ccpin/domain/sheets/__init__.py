"""All closed configurations over a region: how many, on which sheets, and where sheets meet."""

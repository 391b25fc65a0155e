"""Many motions: goal after goal under a supervisor, case after case in a sweep, kept on disk as they are done."""

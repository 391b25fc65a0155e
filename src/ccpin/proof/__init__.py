"""The kernel of proof: whatever is claimed of closures over boxes is checked here, and nothing else is done here.

Imports nothing of ccpin but `errors` and `arrays`: what proposes (searches, the compiled core) has no say.
"""

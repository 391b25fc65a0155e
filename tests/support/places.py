"""Where the project's own models and scripts are, and, where they are beside it, models by others."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MODELS = ROOT / "models"
SCRIPTS = ROOT / "scripts"
SHARED = ROOT.parent / "shared" / "models"
"""Other people's files, not a part of this project; tests that use them skip where the folder is absent."""

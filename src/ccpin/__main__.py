"""``python -m ccpin``: the command line."""

import sys

from ccpin.cli import main

sys.exit(main())

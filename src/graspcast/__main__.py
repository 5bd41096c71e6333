"""``python -m graspcast``."""

import sys

from graspcast.cli import main

sys.exit(main())

"""`python -m nas_data` runs the program `nas`."""

import sys

from nas_data.cli import main

sys.exit(main())

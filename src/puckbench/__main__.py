"""`python -m puckbench`: the command line, without relying on an installed script."""

import sys

from puckbench.cli import main

sys.exit(main())

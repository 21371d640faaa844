"""``python -m o3d_sofnn`` is the command line ``o3d-sofnn``."""

import sys

from o3d_sofnn.cli.main import main

if __name__ == "__main__":
    sys.exit(main())

"""``python -m torchliner``."""

import sys

from torchliner.cli.main import main

sys.exit(main())

#!/usr/bin/env python3
"""Power by speed, sixteen tracks: ``python scripts/process_map.py [--out DIR] [--jobs N]``."""

from study_script import main

if __name__ == "__main__":
    main("process_map", __doc__)

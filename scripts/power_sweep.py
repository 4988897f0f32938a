#!/usr/bin/env python3
"""The paper's power study, 50 to 200 W (section 5.2): ``python scripts/power_sweep.py [--out DIR] [--jobs N]``."""

from study_script import main

if __name__ == "__main__":
    main("power", __doc__)

#!/usr/bin/env python3
"""The 150 W track at four spacings: ``python scripts/resolution_study.py [--out DIR] [--jobs N]``."""

from study_script import main

if __name__ == "__main__":
    main("resolution", __doc__)

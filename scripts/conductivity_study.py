#!/usr/bin/env python3
"""Beds with better conducting grains (section 5.3): ``python scripts/conductivity_study.py [--out DIR] [--jobs N]``."""

from study_script import main

if __name__ == "__main__":
    main("conductivity", __doc__)

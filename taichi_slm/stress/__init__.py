"""How long a step may be: ``taichi-slm stress``."""

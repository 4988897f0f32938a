"""`taichi-slm bench`: what a run costs, what a skip saves, what an error costs; all of it measured."""

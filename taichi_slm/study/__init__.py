"""Many runs of one scene: planned and checked, run in processes, collected into one table."""

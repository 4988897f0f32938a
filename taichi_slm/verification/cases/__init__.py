"""One file a case: the scene, the exact answer in closed form, the limit and why it is what it is."""

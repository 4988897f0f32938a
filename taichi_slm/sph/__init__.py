"""What all terms share: the kernel function, its lattice sums, cells and neighbour lists."""

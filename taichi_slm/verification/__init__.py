"""Cases with known answers, shipped to users: what the program claims, and by how much it misses."""

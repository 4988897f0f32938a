"""Numbers from particles: melt pool, track."""

"""Every door of eyechart under every fault that fits it: the finder of doors, their registry, faults, the matrix."""

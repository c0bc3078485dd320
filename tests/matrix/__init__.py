"""Every door of eyechart under every fault that fits it: the finder of doors, their registry, the faults and the matrix."""

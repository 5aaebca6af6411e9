"""Does the stress at a point reach a known value, and at which order in the mesh?"""

"""`simplify`: which terms, triangles and steps a scene does not need.

variants    simpler scenes to try, each a change of the tables of a scene
numbers     dimensionless numbers of a scene
predictions the change of the motion by a variant, from these numbers
runs        runs of the scene and of its variants, and their changes
outcome     what these runs gave: changes, errors of the scene itself, verdicts
result      the result: its words, its table, its figure
simplify    the study: the variants one by one, then the useful ones together
"""

"""`simplify`: which terms, triangles and steps a scene does not need.

variants    simpler scenes to try, each a change of the tables of a scene
numbers     dimensionless numbers of a scene
predictions the change of the motion by a variant, from these numbers
runs        runs of the scene and of its variants, and their changes
resolution  whether the scene itself is resolved, from half of h and half of dt
search      the useful variants, combined
outcome     what a run of a variant gave
result      the result, its figure and its report
words       its sentences and its table
simplify    the study
"""

"""`fecloth.tune`: the cheapest setting of a problem that meets a tolerance, and its proof.

choices       the settings, and their runs
curves        errors and seconds between and beyond measured runs
time_errors   the error in time of each method
space_errors  the error in space of each element and pattern
shared_steps  the steps that the runs on all meshes share
prediction    the best setting by these errors and seconds
corrections   short runs of the best settings, which correct the prediction
search        the runs that the prediction needs, and why no setting can be proved
proof         the best setting beside a finer one, and the answer among all runs
result        the result: its words, its table, its figure
tune          the study
"""

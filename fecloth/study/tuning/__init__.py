"""`fecloth.tune`: the cheapest setting of a problem that meets a tolerance, and its proof.

choices      the settings, and their runs
curves       errors and seconds between and beyond measured runs
time_errors, space_errors   what the error is made of
prediction   the best setting by these errors and seconds, and `corrections` from short runs
search       the runs that the prediction needs, and why no setting can be proved
proof        the best setting beside a finer one, and the answer among all runs
result       the result: its words, its table, its figure
tune         the study
"""

"""`fecloth.tune`: the cheapest setting of a problem that meets a tolerance, and its proof.

`choices` are the settings, `trials` their runs, `curves` the errors and seconds between measured
runs; `time_errors` and `space_errors` measure what the error is made of, `prediction` chooses by
it, `proof` runs the choice beside a finer one, `reasons` say why none can be proved, and `tune`
puts these in order.
"""

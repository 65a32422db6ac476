# The program says it itself.
wrenchctl completions fish wrenchctl | source

# The program says it itself.
wrenchctl completions fish wrenchd | source

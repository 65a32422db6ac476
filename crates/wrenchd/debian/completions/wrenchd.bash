# The program says it itself.
source <(wrenchctl completions bash wrenchd)

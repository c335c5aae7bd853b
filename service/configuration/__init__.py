"""Where settings come from: a file, the environment and options, in rising precedence; and how they are printed."""

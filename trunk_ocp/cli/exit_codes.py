"""Exit codes of all commands. Imports nothing, as it is needed before anything else."""

SUCCESS = 0
INTERNAL_ERROR = 1  # a bug in this program
BAD_INPUT = 2  # bad usage, a bad file, a missing tool, or a file that cannot be written
NOT_VERIFIED = 3  # a plan that is not solved and verified; an export that fails its check
INTERRUPTED = 4

"""What each command of a terminal needs: options, output, errors and exit codes."""

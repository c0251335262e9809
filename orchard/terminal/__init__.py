"""What each command of a terminal needs: options, output, errors, exit codes. It knows no command."""

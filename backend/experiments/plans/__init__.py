"""What is to be played: settings in, a ``Program`` for the loop out; which there are, what they are set to."""

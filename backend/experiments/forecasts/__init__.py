"""What a plan will ask of motors, joint and tendons, told before it starts."""

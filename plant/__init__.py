"""The thing being controlled: physics, wires and safety module; knows nothing of controllers, web or database."""

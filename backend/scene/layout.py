"""Where the parts of the drawn actuator sit. Metres; x to the right, z up, the joint axis along y at the origin.

The pulley and the reels have their true radii. Each motor rides on a carriage that its tendon pulls against the
compression spring: then the spring shortens by x = r_m θ ∓ r_j q, the elongation of equation 1, and stands where it can
be seen at any joint position.
"""

PLATE_Y = 0.030
PLATE_WIDTH = 0.236
PLATE_TOP = 0.052
PLATE_BOTTOM = -0.305

BRACKET_Z = -0.125
"""Upper seat of the springs; the tendons pass through it."""

SEAT = 0.003
"""Half the thickness of a spring's seat."""

SPRING_FREE = 0.094
SPRING_RADIUS = 0.0200
SPRING_WIRE = 0.0021
SPRING_COILS = 7.0

CARRIAGE_DROP = 0.024
"""From the lower spring seat to the axis of the reel."""

PULLEY_WIDTH = 0.016
LINK_LENGTH = 0.185
LINK_WIDTH = 0.030
LINK_FRONT = -0.019
WALL_THICKNESS = 0.014

TENDON_RADIUS = 0.0019
FAN_TORQUE = 2.0
"""The fan of compliance reaches where this torque [N·m] would hold the joint: ± torque / S."""

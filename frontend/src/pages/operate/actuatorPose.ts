/** From samples to the drawing of the actuator: angles and lengths in the drawing's own units. Pure. */

import { DEGREES } from "../../theme/signals";

/** Reel and pulley [m], spring travel until it is solid [m], torque of the compliance fan [N·m]. */
const R_M = 7.5e-3;
const R_J = 75e-3;
const SOLID_M = 61.4e-3;
const FAN_TORQUE = 2;

const SPRING_FREE = 74;
const SPRING_SOLID = 34;
const COILS = 6;
const COIL_HALF = 9;

export interface Signals {
  readonly q: number;
  readonly q_ref: number;
  readonly S: number;
  readonly theta_A: number;
  readonly theta_B: number;
  readonly F_A: number;
  readonly F_B: number;
}

export interface Side {
  readonly slack: boolean;
  /** Zigzag of the spring from its top as x, y, x, y, …; shorter the more it is compressed. */
  readonly spring: readonly number[];
  readonly springLength: number;
  /** Width of the tendon's line. */
  readonly tendon: number;
  readonly reel_deg: number;
}

export interface ActuatorPose {
  /** Clockwise turn of the link, as a canvas counts; positive q turns it the other way. */
  readonly link_deg: number;
  /** Turn of the reference, null while there is none. */
  readonly ghost_deg: number | null;
  /** Half angle that 2 N·m would deflect the joint; null where the stiffness is not known. */
  readonly fan_deg: number | null;
  /** Whether a tendon is slack: the joint has no stiffness that angles could tell. */
  readonly slack: boolean;
  readonly A: Side;
  readonly B: Side;
}

/** The pose for samples in SI. Elongations follow equation 1 of the paper; NaN is drawn as 0, and no force as taut. */
export function actuatorPose(signals: Signals, slack_N: number): ActuatorPose {
  const value = (name: keyof Signals) => (Number.isFinite(signals[name]) ? signals[name] : 0);
  const x_A = R_M * value("theta_A") - R_J * value("q");
  const x_B = R_M * value("theta_B") + R_J * value("q");
  const A = side(x_A, signals.F_A, -value("theta_A"), slack_N);
  const B = side(x_B, signals.F_B, value("theta_B"), slack_N);
  const slack = A.slack || B.slack;
  return {
    link_deg: -value("q") * DEGREES,
    ghost_deg: Number.isFinite(signals.q_ref) ? -signals.q_ref * DEGREES : null,
    fan_deg:
      slack || Number.isNaN(signals.S) ? null : Math.min(60, (FAN_TORQUE / Math.max(signals.S, 1)) * DEGREES),
    slack,
    A,
    B,
  };
}

function side(elongation_m: number, force_N: number, reel_rad: number, slack_N: number): Side {
  const compressed = Math.min(Math.max(elongation_m / SOLID_M, 0), 1);
  const springLength = SPRING_FREE - compressed * (SPRING_FREE - SPRING_SOLID);
  return {
    slack: force_N < slack_N,
    spring: zigzag(springLength),
    springLength,
    tendon: 1.5 + Math.min(Math.max(force_N || 0, 0), 50) / 14,
    reel_deg: reel_rad * DEGREES,
  };
}

function zigzag(length: number): number[] {
  const step = length / (2 * COILS);
  const points = [0, 0];
  for (let turn = 1; turn < 2 * COILS; turn++)
    points.push(turn % 2 === 1 ? COIL_HALF : -COIL_HALF, turn * step);
  return [...points, 0, length];
}

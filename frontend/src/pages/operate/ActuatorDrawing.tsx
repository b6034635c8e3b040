import { useMemo } from "react";
import { type Surface, useCanvas } from "../../charts/canvas";
import { useLiveStore, useSampleAge } from "../../live/react";
import { age, fixed } from "../../samples/format";
import { type AngleUnit, angleWithUnit } from "../../samples/quantity";
import { fillText } from "../../samples/texts";
import { useAngleUnit } from "../../service/api/preferences";
import { DEGREES, HUES } from "../../theme/signals";
import styles from "./ActuatorDrawing.module.css";
import { TEXTS } from "./texts";

/** Computes angles and lengths of the actuator drawing from samples, in drawing units. Pure. */

/** Radii of reel and pulley [m], travel to the solid spring [m], torque of the compliance fan [N·m]. */
const R_M = 7.5e-3;
const R_J = 75e-3;
const SOLID_M = 61.4e-3;
const FAN_TORQUE = 2;

const SPRING_FREE = 74;
const SPRING_SOLID = 34;
const COILS = 6;
const COIL_HALF = 9;

interface Signals {
  readonly q: number;
  readonly q_ref: number;
  readonly S: number;
  readonly theta_A: number;
  readonly theta_B: number;
  readonly F_A: number;
  readonly F_B: number;
}

interface Side {
  readonly slack: boolean;
  /** Zigzag of the spring from its top as x, y, x, y, …; compression shortens it. */
  readonly spring: readonly number[];
  readonly springLength: number;
  /** Line width of the tendon. */
  readonly tendon: number;
  readonly reel_deg: number;
}

interface ActuatorPose {
  /** Clockwise angle of the link, as in a canvas; positive q turns the link counter-clockwise. */
  readonly link_deg: number;
  /** Clockwise angle of the reference; null without a reference. */
  readonly ghost_deg: number | null;
  /** Deflection under 2 N·m, at most 60°; null if a tendon is slack or the stiffness is unknown. */
  readonly fan_deg: number | null;
  /** Whether a tendon is slack; the angles then do not determine the joint stiffness. */
  readonly slack: boolean;
  readonly A: Side;
  readonly B: Side;
}

/** Returns the pose for samples in SI. Elongations follow equation 1 of the paper.
 * NaN is drawn as 0, and a tendon without a force sample as taut. */
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

/** Paints a pose: link and reference on the pulley, tendons with springs and reels, and values. */

/** Size of the drawing in drawing units; the canvas scales it to fit. */
const WIDTH = 240;
const HEIGHT = 326;
const AXIS_Y = 132;
const PULLEY = 46;
const LINK = 84;
const SPRING_TOP = 198;
const REEL = 13;
const SEAT = 13;
const LEAST_LETTERS_PX = 11;

type Pen = CanvasRenderingContext2D;

function paintActuator(surface: Surface, signals: Signals, pose: ActuatorPose, angles: AngleUnit): void {
  const { context: pen, width, height, colours } = surface;
  const scale = Math.min(width / WIDTH, height / HEIGHT, 1.5);
  pen.save();
  pen.translate(width / 2, (height - scale * HEIGHT) / 2);
  pen.scale(scale, scale);
  pen.lineCap = "round";
  pen.lineJoin = "round";
  paintJoint(pen, pose, colours);
  pen.font = `${letters(scale, 12)}px system-ui, sans-serif`;
  paintSide(pen, -1, pose.A, colours.drawn(HUES.F_A), signals.F_A, colours);
  paintSide(pen, 1, pose.B, colours.drawn(HUES.F_B), signals.F_B, colours);
  pen.fillStyle = colours.text;
  pen.textAlign = "center";
  pen.font = `600 ${letters(scale, 13)}px system-ui, sans-serif`;
  pen.fillText(`q ${sampled(signals.q, (q) => angleWithUnit(q, 1, angles))}`, 0, 16);
  const unknown = Number.isFinite(signals.q) && Number.isNaN(signals.S) ? TEXTS.stiffnessUnknown : null;
  const stiffness = pose.slack
    ? TEXTS.slack
    : (unknown ?? sampled(signals.S, (S) => `${fixed(S, 2)} N·m/rad`));
  pen.fillText(`S ${stiffness}`, 0, HEIGHT - 4);
  pen.restore();
}

/** Returns the formatted value; without a sample a text, because the drawing has no space for a reason. */
function sampled(value: number, format: (value: number) => string): string {
  return Number.isFinite(value) ? format(value) : TEXTS.noSample;
}

/** Returns the font size in drawing units, at least LEAST_LETTERS_PX on the screen. */
function letters(scale: number, wanted: number): number {
  return Math.max(wanted, LEAST_LETTERS_PX / scale);
}

function paintJoint(pen: Pen, pose: ActuatorPose, colours: Surface["colours"]): void {
  pen.save();
  pen.translate(0, AXIS_Y);
  turned(pen, pose.link_deg, () => {
    if (pose.fan_deg !== null) paintFan(pen, pose.fan_deg / DEGREES, colours);
    line(pen, [0, 0, 0, -LINK], colours.drawn(HUES.q), 9);
    disc(pen, PULLEY, colours, 3);
    line(pen, [0, -PULLEY + 9, 0, -PULLEY + 2], colours.axis, 3);
  });
  if (pose.ghost_deg !== null) {
    turned(pen, pose.ghost_deg, () => {
      pen.setLineDash([5, 4]);
      line(pen, [0, -PULLEY - 4, 0, -LINK - 12], colours.drawn(HUES.q), 2.5);
      pen.setLineDash([]);
    });
  }
  pen.fillStyle = colours.text;
  pen.beginPath();
  pen.arc(0, 0, 5, 0, 2 * Math.PI);
  pen.fill();
  pen.restore();
}

/** Paints the sector over which ±2 N·m would deflect the joint. */
function paintFan(pen: Pen, half_rad: number, colours: Surface["colours"]): void {
  pen.globalAlpha = 0.2;
  pen.fillStyle = colours.drawn(HUES.S);
  pen.beginPath();
  pen.moveTo(0, 0);
  pen.arc(0, 0, LINK + 10, -Math.PI / 2 - half_rad, -Math.PI / 2 + half_rad);
  pen.fill();
  pen.globalAlpha = 1;
}

function paintSide(
  pen: Pen,
  outward: -1 | 1,
  side: Side,
  hue: string,
  force_N: number,
  colours: Surface["colours"],
): void {
  pen.save();
  pen.translate(outward * PULLEY, 0);
  pen.setLineDash(side.slack ? [2, 5] : []);
  line(pen, [0, AXIS_Y, 0, SPRING_TOP], hue, side.tendon);
  pen.setLineDash([]);
  line(pen, [-SEAT, SPRING_TOP, SEAT, SPRING_TOP], colours.limit, 4);
  pen.translate(0, SPRING_TOP);
  line(pen, side.spring, colours.axis, 2.2);
  pen.translate(0, side.springLength);
  line(pen, [-SEAT, 0, SEAT, 0], colours.limit, 4);
  pen.translate(0, REEL + 4);
  disc(pen, REEL, colours, 2.5);
  turned(pen, side.reel_deg, () => line(pen, [0, 0, 0, -REEL + 2], colours.axis, 2.5));
  pen.restore();
  pen.fillStyle = colours.text;
  pen.textAlign = outward < 0 ? "right" : "left";
  pen.fillText(
    side.slack ? TEXTS.slack : sampled(force_N, (force) => `${fixed(force, 1)} N`),
    outward * (PULLEY + 12),
    SPRING_TOP - 26,
  );
}

function turned(pen: Pen, degrees: number, paint: () => void): void {
  pen.save();
  pen.rotate(degrees / DEGREES);
  paint();
  pen.restore();
}

/** Draws a line through points given as x, y, x, y, … */
function line(pen: Pen, points: readonly number[], colour: string, width: number): void {
  pen.strokeStyle = colour;
  pen.lineWidth = width;
  pen.beginPath();
  for (let index = 0; index < points.length; index += 2)
    pen.lineTo(points[index] ?? 0, points[index + 1] ?? 0);
  pen.stroke();
}

function disc(pen: Pen, radius: number, colours: Surface["colours"], width: number): void {
  pen.fillStyle = colours.panel;
  pen.strokeStyle = colours.limit;
  pen.lineWidth = width;
  pen.beginPath();
  pen.arc(0, 0, radius, 0, 2 * Math.PI);
  pen.fill();
  pen.stroke();
}

/** Flat drawing of the actuator, cheap on any machine: live, or at one time of a recording. */

const NAMES = ["q", "q_ref", "S", "theta_A", "theta_B", "F_A", "F_B"] as const;

/** Live without `read`, which returns a signal's value and must be the same function for one recording. */
export function ActuatorDrawing({ read }: { read?: (name: string) => number }) {
  const store = useLiveStore();
  const angles = useAngleUnit();
  const drawing = useMemo(() => {
    const value = read ?? ((name: string) => store.window.newest(name));
    const signals = () => Object.fromEntries(NAMES.map((name) => [name, value(name)])) as unknown as Signals;
    return {
      signature: () => NAMES.map((name) => value(name).toFixed(name.startsWith("F") ? 1 : 2)).join() + angles,
      paint: (surface: Parameters<typeof paintActuator>[0]) => {
        const seen = signals();
        const pose = actuatorPose(seen, store.snapshot().state?.limits.F_min ?? 0);
        paintActuator(surface, seen, pose, angles);
      },
    };
  }, [store, read, angles]);
  const canvas = useCanvas(drawing);
  const old_s = useSampleAge();
  const stale = read === undefined && old_s !== null;
  return (
    <canvas
      ref={canvas}
      className={styles.drawing}
      data-stale={stale}
      role="img"
      aria-label={stale ? fillText(TEXTS.actuatorOld, { age: age(1000 * old_s) }) : TEXTS.actuator}
    />
  );
}

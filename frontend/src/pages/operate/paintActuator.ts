/** Paints a pose: link and reference ghost on the pulley, two tendons with their springs and reels, the figures. */

import type { Surface } from "../../charts/useCanvas";
import { fixed } from "../../samples/format";
import { type Angles, angleWithUnit } from "../../samples/quantity";
import { DEGREES, HUES } from "../../theme/signals";
import type { ActuatorPose, Side, Signals } from "./actuatorPose";

/** Size of the picture in its own units; it is scaled to fit. */
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

export function paintActuator(surface: Surface, signals: Signals, pose: ActuatorPose, angles: Angles): void {
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
  const unknown =
    Number.isFinite(signals.q) && Number.isNaN(signals.S) ? "not known before pretension" : null;
  const stiffness = pose.slack ? "slack" : (unknown ?? sampled(signals.S, (S) => `${fixed(S, 2)} N·m/rad`));
  pen.fillText(`S ${stiffness}`, 0, HEIGHT - 4);
  pen.restore();
}

/** A picture has no room for a reason beside a dash: it says itself that nothing was sampled. */
function sampled(value: number, told: (value: number) => string): string {
  return Number.isFinite(value) ? told(value) : "not sampled";
}

/** Height of letters in the picture's units so that they stay readable when it is small. */
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

/** Where 2 N·m to either side would hold the joint. */
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
    side.slack ? "slack" : sampled(force_N, (force) => `${fixed(force, 1)} N`),
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

/** A line through points given as x, y, x, y, … */
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

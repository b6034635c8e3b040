/** What a part will do, in words: from what is written, and from what the service has laid out of it. Pure. */

import { short } from "../../samples/format";
import { type Angles, told } from "../../samples/quantity";
import { counted } from "../../samples/words";
import type { PartPlayed } from "../../wire/types";
import type { Part } from "./document";

/** A number with its unit as it is read; an expression as it is written; null for what is left out. */
function said(part: Part, name: string, unit: string, angles: Angles): string | null {
  const value = part[name];
  if (typeof value === "number") return told(value, unit, angles);
  return typeof value === "string" ? value : null;
}

function aim(part: Part, angles: Angles): string {
  const q = said(part, "q_ref", "rad", angles);
  const S = said(part, "S_ref", "N·m/rad", angles);
  const named = [q === null ? null : `q to ${q}`, S === null ? null : `S to ${S}`].filter(
    (one) => one !== null,
  );
  return named.length === 0 ? "nothing" : named.join(" and ");
}

function swing(part: Part, angles: Angles): string {
  const q = part.q_amplitude === 0 ? null : said(part, "q_amplitude", "rad", angles);
  const S = part.S_amplitude === 0 ? null : said(part, "S_amplitude", "N·m/rad", angles);
  const named = [q === null ? null : `q by ±${q}`, S === null ? null : `S by ±${S}`].filter(
    (one) => one !== null,
  );
  return named.length === 0 ? "nothing" : named.join(" and ");
}

/** What is written. */
export function partInWords(part: Part, angles: Angles): string {
  const time = said(part, "duration_s", "s", angles) ?? "";
  const of = (name: string, unit: string) => said(part, name, unit, angles) ?? "…";
  switch (part.do) {
    case "hold":
      return `holds the references for ${time}`;
    case "step":
      return `jumps ${aim(part, angles)}, stays ${time}`;
    case "ramp":
      return `ramps ${aim(part, angles)} in ${time}`;
    case "pulse":
      return `jumps ${aim(part, angles)} for ${time}, and back for ${of("rest_s", "s")}`;
    case "sine":
      return `swings ${swing(part, angles)} with a period of ${of("period_s", "s")}${turns(part)} for ${time}${fastest(part, angles)}`;
    case "sweep":
      return `swings ${swing(part, angles)} from ${of("from_Hz", "Hz")} to ${of("to_Hz", "Hz")} in ${time}`;
    case "prbs":
      return `jumps ${swing(part, angles)} by a binary sequence of ${of("bits", "1")} bits, ${of("chip_s", "s")} each`;
    case "multisine":
      return `swings ${swing(part, angles)} by ${of("lines", "1")} harmonics of ${of("period_s", "s")}`;
    case "push":
      return `pushes the joint with ${of("F_push", "N")} for ${time}, on the simulator`;
    case "hand":
      return `pushes ${of("pushes", "1")} times like a hand, up to ${of("F_push", "N")}, on the simulator`;
    case "load":
      return `loads the motors' shafts for ${time}, on the simulator`;
    case "wall":
      return `puts a wall ${part.side ?? "above"} ${of("q_wall", "rad")}, on the simulator`;
    case "no_wall":
      return "takes the wall away";
    case "tuning":
      return tuning(part, angles);
    case "learn":
      return `rests ${time || "2 s"}: what the outside force reads is taken off from then on`;
    case "until_contact":
      return `plays its parts until a force above ${said(part, "contact_N", "N", angles) ?? "1.5 N"} is felt`;
    case "repeat":
      return `plays its parts ${of("times", "1")} times; ${part.index ?? "i"} counts from 0`;
    case "choose":
      return `plays the parts under the value of ${part.by}`;
    default:
      return "is not known";
  }
}

function turns({ duration_s, period_s }: Part): string {
  if (typeof duration_s !== "number" || typeof period_s !== "number" || period_s <= 0) return "";
  const count = Number((duration_s / period_s).toPrecision(3));
  return `, ${Number.isInteger(count) ? counted(count, "turn") : `${short(count)} turns`},`;
}

/** The largest rate of a sine of q, a·2π/T. */
function fastest({ q_amplitude, period_s }: Part, angles: Angles): string {
  if (typeof q_amplitude !== "number" || typeof period_s !== "number" || period_s <= 0 || q_amplitude === 0)
    return "";
  return `, ${rate((Math.abs(q_amplitude) * 2 * Math.PI) / period_s, "rad/s", angles)} at most`;
}

function tuning(part: Part, angles: Angles): string {
  const named = Object.entries(part).filter(([name]) => name !== "do");
  const words: Record<string, string> = {
    lam_q: "λ_q",
    lam_S: "λ_S",
    lam_motor: "λ_motor",
    u_plan: "U_plan",
  };
  const units: Record<string, string> = { lam_q: "s", lam_S: "s", lam_motor: "s", u_plan: "V" };
  const parts = named.map(([name, value]) => {
    const shown =
      typeof value === "boolean" ? (value ? "yes" : "no") : said(part, name, units[name] ?? "1", angles);
    return `${words[name] ?? name} = ${shown}`;
  });
  return parts.length === 0 ? "changes nothing of the tuning" : `from the next motion on ${parts.join(", ")}`;
}

/** What the service has laid out of it: when, and how fast a ramp is. */
export function playedInWords(part: Part, played: PartPlayed, angles: Angles): string {
  const words = [`at ${short(played.start_s)} to ${told(played.end_s, "s", angles)}`];
  if (part.do === "ramp" && played.piece_s > 0) {
    for (const [name, from, to, unit] of [
      ["q", played.q_from, played.q_to, "rad"],
      ["S", played.S_from, played.S_to, "N·m/rad"],
    ] as const) {
      if (from === null || from === to) continue;
      const speed = rate((to - from) / played.piece_s, unit === "rad" ? "rad/s" : "N·m/rad/s", angles);
      words.push(`${name} from ${told(from, unit, angles)}, ${speed}`);
    }
  }
  return words.join(", ");
}

function rate(value: number, unit: string, angles: Angles): string {
  return told(Number(value.toPrecision(3)), unit, angles).replace(
    /^(−?)(\d+\.?\d*)/,
    (_, sign, number) => `${sign}${short(Number(number), 3)}`,
  );
}

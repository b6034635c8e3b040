/**
 * The one place where a quantity is turned into what a person reads or types, and back. SI on the wire and in the
 * code; angles in the unit that the person chose. What is converted hangs on the unit alone: gains per radian
 * (N·m/rad, rad/(V·s)) stay as the paper has them. The service has the same rules in `backend/reading.py`. Pure.
 */

import { fixed, MINUS } from "./format";
import { numberIn } from "./number";

export type Angles = "deg" | "rad";

/** A unit as it is read, and the factor from SI to it. */
export interface Reading {
  readonly unit: string;
  readonly factor: number;
}

const TO_DEGREES = 180 / Math.PI;
const TO_RADIANS = Math.PI / 180;
const IN_DEGREES: Readonly<Record<string, Reading>> = {
  rad: { unit: "deg", factor: TO_DEGREES },
  "rad/s": { unit: "deg/s", factor: TO_DEGREES },
  mrad: { unit: "deg", factor: TO_DEGREES / 1000 },
  rad·s: { unit: "deg·s", factor: TO_DEGREES },
};

/** Digits that a typed number keeps on its way to SI and back; the doubles between hold fifteen. */
const TYPED = 12;
/** Most digits of a number that nobody typed. */
const READ = 6;
/** Digits of a bound that six do not hold: enough to choose by. */
const BOUND = 4;
/** A number that comes back with so few characters was typed, or might have been. */
const SHORT = 9;

export function readingOf(unit: string, angles: Angles): Reading {
  return (angles === "deg" ? IN_DEGREES[unit] : undefined) ?? { unit, factor: 1 };
}

/** Units that take a prefix where a number is small. */
const PREFIXED: ReadonlySet<string> = new Set(["V", "N", "s", "m", "A"]);

/**
 * How a quantity is read whose largest figure is `largest` in SI: as `readingOf`, and small volts, newtons, seconds,
 * metres and amperes with the prefix that makes them numbers from 1 on.
 */
export function readingNear(largest: number, unit: string, angles: Angles): Reading {
  const size = Math.abs(largest);
  if (!PREFIXED.has(unit) || !(size > 0) || size >= 1e-3) return readingOf(unit, angles);
  return size >= 1e-6 ? { unit: `µ${unit}`, factor: 1e6 } : { unit: `n${unit}`, factor: 1e9 };
}

/** A value in SI as it stands in a number box: as it was typed, or else to six digits. */
export function boxText(value: number, unit: string, angles: Angles): string {
  if (!(unit in IN_DEGREES)) return String(value);
  const shown = value * readingOf(unit, angles).factor;
  const typed = String(Number(shown.toPrecision(TYPED)));
  return typed.length <= SHORT ? typed : String(Number(shown.toPrecision(READ)));
}

/** The number that a text in a box is, in SI; null for what is no number. */
export function inSI(text: string, unit: string, angles: Angles): number | null {
  const typed = numberIn(text);
  if (typed === null) return null;
  return toSI(typed, unit, angles);
}

/** A number as it is read, in SI. */
export function toSI(shown: number, unit: string, angles: Angles): number {
  switch (readingOf(unit, angles).factor) {
    case 1:
      return shown;
    case TO_DEGREES:
      return shown * TO_RADIANS;
    default:
      return shown / readingOf(unit, angles).factor;
  }
}

/** A value in SI as a number to be read in a sentence, with its unit: "120 deg". */
export function told(value: number, unit: string, angles: Angles): string {
  const { factor } = readingOf(unit, angles);
  const number = String(Number((value * factor).toPrecision(READ))).replaceAll("-", MINUS);
  return unit === "1" || unit === "" ? number : `${number} ${readingOf(unit, angles).unit}`;
}

/** A range in SI as a hint below a box: "−80.21 … 80.21"; the unit stands in the label. Who types an end is accepted. */
export function rangeText(minimum: number, maximum: number, unit: string, angles: Angles): string {
  const { factor } = readingOf(unit, angles);
  return `${boundText(minimum * factor, Math.ceil)} … ${boundText(maximum * factor, Math.floor)}`;
}

/** A bound as `backend/refusal.py` writes it: exactly, or in four digits rounded towards the inside. */
function boundText(shown: number, inwards: (value: number) => number): string {
  const read = Number(shown.toPrecision(READ));
  if (Number.isInteger(shown) || Math.abs(read - shown) <= 1e-12 * Math.abs(shown)) {
    return String(Number(shown.toPrecision(TYPED))).replaceAll("-", MINUS);
  }
  const place = 10 ** (Math.floor(Math.log10(Math.abs(shown))) - BOUND + 1);
  return String(Number((inwards(shown / place) * place).toPrecision(READ))).replaceAll("-", MINUS);
}

/** What stands over a box, a column or an axis: with the unit, where there is one. */
export function labelWith(words: string, unit: string, angles: Angles): string {
  return unit === "1" || unit === "" ? words : `${words} [${readingOf(unit, angles).unit}]`;
}

/** An angle in SI with so many decimals of a degree, and as finely in radians. */
export function angleText(value: number, decimals: number, angles: Angles): string {
  return fixed(value * readingOf("rad", angles).factor, decimals + (angles === "deg" ? 0 : FINER));
}

/** Further decimals that an angle needs in radians to be told as finely as in degrees. */
export const FINER = 2;

const NUMBER = String.raw`[-+−]?(?:\d+\.?\d*|\.\d+)(?:e[-+−]?\d+)?`;
const ANGLE = new RegExp(
  String.raw`(?<![\w.])(${NUMBER})(?:( to | … )(${NUMBER}))? (rad|deg)(/s)?(?![\w/(·²³⁴])`,
  "g",
);

/**
 * A text of the service (a mark, a fault, a refusal) with the angles in it as they are read; everybody is sent the same
 * text. A number keeps as many digits as it came with, four at least.
 */
export function inWords(text: string, angles: Angles): string {
  return text.replace(ANGLE, (found, low, to, high, unit, rate) => {
    if (unit === angles) return found;
    const factor = angles === "deg" ? TO_DEGREES : TO_RADIANS;
    const numbers = [low, high].filter((number) => number !== undefined);
    return `${numbers.map((number) => asFine(number, factor)).join(to)} ${angles}${rate ?? ""}`;
  });
}

function asFine(number: string, factor: number): string {
  const digits = number.replace(/e.*|\D/g, "").replace(/^0+/, "").length;
  const value = Number(number.replaceAll("−", "-")) * factor;
  const turned = String(Number(value.toPrecision(Math.min(Math.max(digits, 4), READ))));
  return number.includes("−") ? turned.replaceAll("-", "−") : turned;
}

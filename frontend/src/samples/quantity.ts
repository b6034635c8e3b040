/**
 * Converts quantities between SI and the units that a person reads and types; no other module does this. The wire and
 * the code use SI; angles have the unit that the person chose. Only the unit determines the conversion: gains per
 * radian (N·m/rad, rad/(V·s)) retain the paper's unit. `backend/units.py` contains the same rules for the service.
 * Pure.
 */

import { fixed, MINUS, numberIn, short } from "./format";

export type AngleUnit = "deg" | "rad";

/** Displayed unit, and the factor from SI to it. */
interface Reading {
  readonly unit: string;
  readonly factor: number;
}

const TO_DEGREES = 180 / Math.PI;
const TO_RADIANS = Math.PI / 180;
const IN_DEGREES: Readonly<Record<string, Reading>> = {
  rad: { unit: "°", factor: TO_DEGREES },
  "rad/s": { unit: "°/s", factor: TO_DEGREES },
  mrad: { unit: "°", factor: TO_DEGREES / 1000 },
  rad·s: { unit: "°·s", factor: TO_DEGREES },
};
const WRITTEN: Readonly<Record<AngleUnit, string>> = { deg: "°", rad: " rad" };

/** Digits of a typed number that a conversion to SI and back preserves; doubles have fifteen. */
const TYPED = 12;
/** Most digits of a computed number. */
const READ = 6;
/** Digits of a bound that is not an integer, and of an angle that a form offers. */
const BOUND = 3;
/** Longest text of a number that counts as typed. */
const SHORT = 9;

export function readingOf(unit: string, angles: AngleUnit): Reading {
  return (angles === "deg" ? IN_DEGREES[unit] : undefined) ?? { unit, factor: 1 };
}

/** A number with its displayed unit: "60°", "12.5 N", "0.5" without a unit. */
export function withUnit(number: string, unit: string): string {
  if (unit === "1" || unit === "") return number;
  return unit.startsWith("°") ? `${number}${unit}` : `${number} ${unit}`;
}

/** Units that small numbers show with a prefix. */
const PREFIXED: ReadonlySet<string> = new Set(["V", "N", "s", "m", "A"]);

/**
 * Displayed unit of a quantity whose largest value is `largest` in SI: as `readingOf`, with a prefix for small volts,
 * newtons, seconds, metres and amperes so that numbers are at least 1.
 */
export function readingNear(largest: number, unit: string, angles: AngleUnit): Reading {
  const size = Math.abs(largest);
  if (!PREFIXED.has(unit) || !(size > 0) || size >= 1e-3) return readingOf(unit, angles);
  return size >= 1e-6 ? { unit: `µ${unit}`, factor: 1e6 } : { unit: `n${unit}`, factor: 1e9 };
}

/** A value in SI as text of a number box: as it was typed, otherwise with six digits. */
export function boxText(value: number, unit: string, angles: AngleUnit): string {
  if (!(unit in IN_DEGREES)) return plain(value);
  const shown = value * readingOf(unit, angles).factor;
  const typed = String(Number(shown.toPrecision(TYPED)));
  return typed.length <= SHORT ? typed : String(Number(shown.toPrecision(READ)));
}

/** A number without exponent, unless it is extremely small. */
function plain(value: number): string {
  const text = String(value);
  return text.includes("e-") && Math.abs(value) > 1e-12 ? value.toFixed(15).replace(/0+$/, "") : text;
}

interface Declared {
  readonly unit: string;
  readonly minimum?: number | null;
  readonly maximum?: number | null;
}

/**
 * Default of a setting in a form: an angle is rounded to few digits of the displayed unit, because the form sends the
 * number that it shows. Other values, and values that rounding moves out of the range, do not change.
 */
export function offeredDefault<T>(
  value: T,
  { unit, minimum, maximum }: Declared,
  angles: AngleUnit,
): T | number {
  const { factor } = readingOf(unit, angles);
  if (typeof value !== "number" || factor === 1) return value;
  const rounded = Number((value * factor).toPrecision(BOUND));
  if (Math.abs(rounded - value * factor) <= 1e-9 * Math.abs(rounded)) return value;
  const inRange = toSI(rounded, unit, angles);
  return inRange < (minimum ?? inRange) || inRange > (maximum ?? inRange) ? value : inRange;
}

/** Number of a box's text in SI; null if the text is not a number. */
export function inSI(text: string, unit: string, angles: AngleUnit): number | null {
  const typed = numberIn(text);
  if (typed === null) return null;
  return toSI(typed, unit, angles);
}

/** Converts a displayed number to SI. */
export function toSI(shown: number, unit: string, angles: AngleUnit): number {
  switch (readingOf(unit, angles).factor) {
    case 1:
      return shown;
    case TO_DEGREES:
      return shown * TO_RADIANS;
    default:
      return shown / readingOf(unit, angles).factor;
  }
}

/** A value in SI as text with its unit: "120°". */
export function formatWithUnit(value: number, unit: string, angles: AngleUnit): string {
  const reading = readingNear(value, unit, angles);
  return withUnit(short(value * reading.factor, READ), reading.unit);
}

/**
 * A range in SI as a hint below a box: "−80.2 to 80.2"; the label contains the unit. Both bounds are accepted when
 * typed.
 */
export function rangeText(minimum: number, maximum: number, unit: string, angles: AngleUnit): string {
  const { factor } = readingOf(unit, angles);
  return rangeOf(minimum * factor, maximum * factor);
}

/** A range of displayed numbers, with enough digits that the bounds differ. */
export function rangeOf(low: number, high: number): string {
  for (let digits = BOUND; ; digits += 1) {
    const [from, to] = [bound(low, Math.ceil, digits), bound(high, Math.floor, digits)];
    if (from < to || digits >= 15) return [from, to].map((end) => short(end, TYPED)).join(" to ");
  }
}

/** A range with its unit: "−80.2 to 80.2°". */
export function rangeWithUnit(minimum: number, maximum: number, unit: string, angles: AngleUnit): string {
  return withUnit(rangeText(minimum, maximum, unit, angles), readingOf(unit, angles).unit);
}

/** A bound formatted like `backend/errors.py`: an integer, or with few digits and rounded inwards. */
function bound(shown: number, inwards: (value: number) => number, digits: number): number {
  const read = Number(shown.toPrecision(digits));
  if (Number.isInteger(shown) || Math.abs(read - shown) <= 1e-12 * Math.abs(shown)) {
    return Number.isInteger(shown) ? shown : read;
  }
  const place = 10 ** (Math.floor(Math.log10(Math.abs(shown))) - digits + 1);
  return Number((inwards(shown / place) * place).toPrecision(Math.max(digits, READ)));
}

/** Label of a box, a column or an axis, with the unit if there is one. */
export function labelWith(words: string, unit: string, angles: AngleUnit): string {
  return unit === "1" || unit === "" ? words : `${words} [${readingOf(unit, angles).unit}]`;
}

/** An angle in SI with a number of decimals for degrees, and with the same resolution in radians. */
export function angleText(value: number, decimals: number, angles: AngleUnit): string {
  return fixed(value * readingOf("rad", angles).factor, decimals + (angles === "deg" ? 0 : FINER));
}

/** The same with its unit: "30.0°". */
export function angleWithUnit(value: number, decimals: number, angles: AngleUnit): string {
  return `${angleText(value, decimals, angles)}${WRITTEN[angles]}`;
}

/** Additional decimals with which radians have the resolution of degrees. */
export const FINER = 2;

/** Separates number and unit of a quantity in a text of the service; see `plant/quantity.py`. */
const UNIT_MARK = "\u202f";
/** Follows a mark in a person's text, so that it is not converted. */
const ESCAPE = "\u2060";

const NUMBER = String.raw`[-+−]?(?:\d+\.?\d*|\.\d+)(?:e[-+−]?\d+)?`;
const QUANTITY = new RegExp(
  String.raw`(?<![\w.·])(?<low>${NUMBER})(?:(?<to> to | … )(?<high>${NUMBER}))?` +
    String.raw`${UNIT_MARK}(?!${ESCAPE})(?:(?<angle>rad|deg|°)(?<rate>/s)?|(?<unit>[VNsmA]))(?![\w/(·²³⁴])`,
  "g",
);
const ESCAPED = new RegExp(`${UNIT_MARK}(${ESCAPE}*)`, "g");

/**
 * Converts the marked quantities of a text of the service (a mark, a fault, a refusal) to the person's units;
 * everyone receives the same text. An angle retains its number of digits, at least four. A person's text does not
 * change.
 */
export function localizeText(text: string, angles: AngleUnit): string {
  return text
    .replace(QUANTITY, (_, ...more: unknown[]) => {
      const named = more[more.length - 1] as Readonly<Record<string, string | undefined>>;
      const numbers = [named.low, named.high].filter((number) => number !== undefined);
      if (named.unit !== undefined) {
        const [number = ""] = numbers;
        if (numbers.length === 1 && number.includes("e")) return prefixed(number, named.unit);
        return `${numbers.join(named.to)} ${named.unit}`;
      }
      const factor = angles === "deg" ? TO_DEGREES : TO_RADIANS;
      const read =
        (named.angle === "rad") === (angles === "rad") ? numbers : numbers.map((one) => asFine(one, factor));
      return `${read.join(named.to)}${WRITTEN[angles]}${named.rate ?? ""}`;
    })
    .replace(ESCAPED, (_, escapes: string) => (escapes === "" ? " " : UNIT_MARK + escapes.slice(1)));
}

function prefixed(number: string, unit: string): string {
  const reading = readingNear(Number(number.replaceAll(MINUS, "-")), unit, "rad");
  return withUnit(asFine(number, reading.factor), reading.unit);
}

function asFine(number: string, factor: number): string {
  const digits = number.replace(/e.*|\D/g, "").replace(/^0+/, "").length;
  const value = Number(number.replaceAll(MINUS, "-")) * factor;
  const turned = String(Number(value.toPrecision(Math.min(Math.max(digits, 4), READ))));
  return number.includes(MINUS) ? turned.replaceAll("-", MINUS) : turned;
}

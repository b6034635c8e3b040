/**
 * The one place where a quantity is turned into what a person reads or types, and back. SI on the wire and in the
 * code; angles in the unit that the person chose. What is converted hangs on the unit alone: gains per radian
 * (N·m/rad, rad/(V·s)) stay as the paper has them. The service has the same rules in `backend/units.py`. Pure.
 */

import { fixed, MINUS, numberIn, short } from "./format";

export type AngleUnit = "deg" | "rad";

/** A unit as it is read, and the factor from SI to it. */
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

/** Digits that a typed number keeps on its way to SI and back; the doubles between hold fifteen. */
const TYPED = 12;
/** Most digits of a number that nobody typed. */
const READ = 6;
/** Digits of a bound that is no whole number, and of an angle that a form offers: enough to choose by. */
const BOUND = 3;
/** A number that comes back with so few characters was typed, or might have been. */
const SHORT = 9;

export function readingOf(unit: string, angles: AngleUnit): Reading {
  return (angles === "deg" ? IN_DEGREES[unit] : undefined) ?? { unit, factor: 1 };
}

/** A number with its unit as it is read: "60°", "12.5 N", "0.5" of what has no unit. */
export function withUnit(number: string, unit: string): string {
  if (unit === "1" || unit === "") return number;
  return unit.startsWith("°") ? `${number}${unit}` : `${number} ${unit}`;
}

/** Units that take a prefix where a number is small. */
const PREFIXED: ReadonlySet<string> = new Set(["V", "N", "s", "m", "A"]);

/**
 * How a quantity is read whose largest figure is `largest` in SI: as `readingOf`, and small volts, newtons, seconds,
 * metres and amperes with the prefix that makes them numbers from 1 on.
 */
export function readingNear(largest: number, unit: string, angles: AngleUnit): Reading {
  const size = Math.abs(largest);
  if (!PREFIXED.has(unit) || !(size > 0) || size >= 1e-3) return readingOf(unit, angles);
  return size >= 1e-6 ? { unit: `µ${unit}`, factor: 1e6 } : { unit: `n${unit}`, factor: 1e9 };
}

/** A value in SI as it stands in a number box: as it was typed, or else to six digits. */
export function boxText(value: number, unit: string, angles: AngleUnit): string {
  if (!(unit in IN_DEGREES)) return plain(value);
  const shown = value * readingOf(unit, angles).factor;
  const typed = String(Number(shown.toPrecision(TYPED)));
  return typed.length <= SHORT ? typed : String(Number(shown.toPrecision(READ)));
}

/** A number without exponent, as far as a person types zeros. */
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
 * The default of a setting as a form offers it: an angle in few digits of the unit in which it is read, since what is
 * shown is sent; as it is where that would leave its range, and where it is no angle.
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

/** The number that a text in a box is, in SI; null for what is no number. */
export function inSI(text: string, unit: string, angles: AngleUnit): number | null {
  const typed = numberIn(text);
  if (typed === null) return null;
  return toSI(typed, unit, angles);
}

/** A number as it is read, in SI. */
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

/** A value in SI as a number to be read in a sentence, with its unit: "120°". */
export function formatWithUnit(value: number, unit: string, angles: AngleUnit): string {
  const reading = readingNear(value, unit, angles);
  return withUnit(short(value * reading.factor, READ), reading.unit);
}

/** A range in SI as a hint below a box: "−80.2 to 80.2"; the unit stands in the label. Who types an end is accepted. */
export function rangeText(minimum: number, maximum: number, unit: string, angles: AngleUnit): string {
  const { factor } = readingOf(unit, angles);
  return rangeOf(minimum * factor, maximum * factor);
}

/** The same of numbers as they are read, in as many digits as it takes to leave something between the ends. */
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

/** A bound as `backend/errors.py` writes it: a whole number, or in few digits rounded towards the inside. */
function bound(shown: number, inwards: (value: number) => number, digits: number): number {
  const read = Number(shown.toPrecision(digits));
  if (Number.isInteger(shown) || Math.abs(read - shown) <= 1e-12 * Math.abs(shown)) {
    return Number.isInteger(shown) ? shown : read;
  }
  const place = 10 ** (Math.floor(Math.log10(Math.abs(shown))) - digits + 1);
  return Number((inwards(shown / place) * place).toPrecision(Math.max(digits, READ)));
}

/** What stands over a box, a column or an axis: with the unit, where there is one. */
export function labelWith(words: string, unit: string, angles: AngleUnit): string {
  return unit === "1" || unit === "" ? words : `${words} [${readingOf(unit, angles).unit}]`;
}

/** An angle in SI with so many decimals of a degree, and as finely in radians. */
export function angleText(value: number, decimals: number, angles: AngleUnit): string {
  return fixed(value * readingOf("rad", angles).factor, decimals + (angles === "deg" ? 0 : FINER));
}

/** The same with its unit: "30.0°". */
export function angleWithUnit(value: number, decimals: number, angles: AngleUnit): string {
  return `${angleText(value, decimals, angles)}${WRITTEN[angles]}`;
}

/** Further decimals that an angle needs in radians to be told as finely as in degrees. */
export const FINER = 2;

/** Separates the number and the unit of a quantity that the service has written, as `plant/quantity.py`. */
const UNIT_MARK = "\u202f";
/** Follows a mark that a person has written: nothing converts it. */
const ESCAPE = "\u2060";

const NUMBER = String.raw`[-+−]?(?:\d+\.?\d*|\.\d+)(?:e[-+−]?\d+)?`;
const QUANTITY = new RegExp(
  String.raw`(?<![\w.·])(?<low>${NUMBER})(?:(?<to> to | … )(?<high>${NUMBER}))?` +
    String.raw`${UNIT_MARK}(?!${ESCAPE})(?:(?<angle>rad|deg|°)(?<rate>/s)?|(?<unit>[VNsmA]))(?![\w/(·²³⁴])`,
  "g",
);
const ESCAPED = new RegExp(`${UNIT_MARK}(${ESCAPE}*)`, "g");

/**
 * A text of the service (a mark, a fault, a refusal) with its marked quantities as one person reads them; everybody is
 * sent the same text. An angle keeps its number of digits, four at least. What a person has written stays as it is.
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

/** Formats numbers, times and names as text, and parses typed numbers. Pure. */

/** Formats numbers and times with constant width. `Absent` shows a missing value, with the reason. Pure. */

export const MINUS = "−";
/** Text for a number that is not finite; callers that expect one show the reason instead. */
const NO_NUMBER = "no value";
export const NOT_MEASURED = "not measured";

/** A number with fixed decimals, a true minus sign, and no negative zero. */
export function fixed(value: number, decimals: number): string {
  if (!Number.isFinite(value)) return NO_NUMBER;
  const text = value.toFixed(decimals);
  return Number(text) === 0 ? text.replace("-", "") : text.replace("-", MINUS);
}

/** A share in %, with more decimals if a share below 100 would round to "100.0". */
export function percent(value: number, decimals: number): string {
  let most = decimals;
  while (value < 100 && most < 12 && Number(value.toFixed(most)) >= 100) most += 1;
  return fixed(value, most);
}

/** Decimals that represent multiples of `step` exactly; negative if it is a multiple of a power of ten. */
export function decimalsOf(step: number): number {
  const [digits, exponent] = step.toExponential(3).split("e") as [string, string];
  const behind = digits.replace(/\.?0+$/, "").split(".")[1]?.length ?? 0;
  return behind - Number(exponent);
}

/** A number with this many significant digits, without exponent if that is short. */
export function significant(value: number, digits: number): string {
  if (!Number.isFinite(value)) return NO_NUMBER;
  if (value === 0) return "0";
  const magnitude = Math.floor(Math.log10(Math.abs(value)));
  if (magnitude < -5 || magnitude > 6) return withPower(value.toExponential(digits - 1));
  return fixed(value, Math.max(0, digits - 1 - magnitude));
}

const SUPERSCRIPTS: Readonly<Record<string, string>> = {
  "-": "⁻",
  ...Object.fromEntries([..."⁰¹²³⁴⁵⁶⁷⁸⁹"].map((letter, digit) => [String(digit), letter])),
};

/** Formats JavaScript's notation with a true minus sign and the exponent as a power of ten: "3.3·10⁻⁷". */
function withPower(text: string): string {
  const [number = "", exponent] = text.split("e");
  const plain = number.replace("-", MINUS);
  return exponent === undefined ? plain : `${plain}·10${superscript(Number(exponent))}`;
}

function superscript(power: number): string {
  return [...String(power)].map((letter) => SUPERSCRIPTS[letter]).join("");
}

/**
 * A value with its standard error: the error with two significant digits, the value to the same decimal place, and
 * one power of ten for both if they are large or small. Without a valid error, only the value.
 */
export function withError(value: number, error: number): string {
  if (!(error > 0) || !Number.isFinite(error) || !Number.isFinite(value)) return significant(value, 4);
  const place = Math.floor(Math.log10(Number(error.toPrecision(2)))) - 1;
  const size = Math.floor(Math.log10(Math.max(Math.abs(value), error)));
  if (size < 5 && size > -4) {
    const rounded = (number: number) =>
      fixed(Math.round(number / 10 ** place) * 10 ** place, Math.max(0, -place));
    return `${rounded(value)} ± ${rounded(error)}`;
  }
  const decimals = Math.max(0, size - place);
  const scaled = (number: number) => fixed(number / 10 ** size, decimals);
  return `(${scaled(value)} ± ${scaled(error)})·10${superscript(size)}`;
}

/** A value of a result; null was not measured, and the reason is shown with it. */
export function measured(value: number | null, digits: number): string {
  return value === null ? NOT_MEASURED : significant(value, digits);
}

/** A setting: numbers to six digits, the most that a person types. */
export function settingValue(value: boolean | number | string): string {
  if (typeof value === "boolean") return value ? "yes" : "no";
  if (typeof value === "string") return value;
  return short(value, 6);
}

/** A number with at most this many digits, as short as possible: 0.5, 8.25, 50. */
export function short(value: number, digits = 4): string {
  return withPower(String(Number(value.toPrecision(digits))));
}

/** Number of significant digits, at least `least`, at which different numbers have different texts. */
export function digitsApart(values: readonly number[], least = 4): number {
  const different = new Set(values).size;
  let digits = least;
  while (digits < 17 && new Set(values.map((value) => short(value, digits))).size < different) digits += 1;
  return digits;
}

/** Number of digits that resolves a twentieth of the range of the values. */
export function digitsOver(values: readonly number[], least = 4): number {
  const [low, high] = [Math.min(...values), Math.max(...values)];
  return values.length === 0 ? least : digitsApart([low, low + (high - low) / 20, high], least);
}

/** Rate of the control loop in kHz. */
export function kilohertz(rate_Hz: number): string {
  return `${fixed(rate_Hz / 1000, 3)} kHz`;
}

/** An age or a latency: milliseconds below a second, then seconds, then minutes. */
export function age(ms: number): string {
  if (ms < 1000) return `${fixed(ms, 0)} ms`;
  if (ms < 60_000) return `${fixed(ms / 1000, 1)} s`;
  return `${fixed(Math.floor(ms / 60_000), 0)} min`;
}

/** Duration of a run. */
export function duration(seconds: number): string {
  if (seconds < 60) return `${fixed(seconds, 1)} s`;
  const whole = Math.round(seconds);
  const minutes = Math.floor(whole / 60);
  const rest = String(whole % 60).padStart(2, "0");
  if (minutes < 60) return `${minutes}:${rest} min`;
  return `${Math.floor(minutes / 60)}:${String(minutes % 60).padStart(2, "0")}:${rest} h`;
}

/** A time on the axis as m:ss, with as many decimals as the step between points needs. */
export function clockTime(seconds: number, step_s: number): string {
  const decimals = Math.min(6, Math.max(0, decimalsOf(step_s)));
  const sign = seconds < 0 ? MINUS : "";
  const scaled = Math.round(Math.abs(seconds) * 10 ** decimals);
  const minutes = Math.floor(scaled / (60 * 10 ** decimals));
  const rest = (scaled - minutes * 60 * 10 ** decimals) / 10 ** decimals;
  const width = decimals === 0 ? 2 : 3 + decimals;
  return `${sign}${minutes}:${rest.toFixed(decimals).padStart(width, "0")}`;
}

/** Time of day in the person's time zone, with as many decimals as the step between points needs. */
export function dayTime(epoch_s: number, step_s: number): string {
  const decimals = Math.min(3, Math.max(0, decimalsOf(step_s)));
  const when = new Date(Math.round(epoch_s * 10 ** decimals) * 10 ** (3 - decimals));
  const two = (part: number) => String(part).padStart(2, "0");
  const behind =
    decimals === 0 ? "" : `.${String(when.getMilliseconds()).padStart(3, "0").slice(0, decimals)}`;
  return `${two(when.getHours())}:${two(when.getMinutes())}:${two(when.getSeconds())}${behind}`;
}

/** Date and time in the person's time zone, to the second. */
export function dateTime(iso: string): string {
  const when = new Date(iso);
  if (Number.isNaN(when.getTime())) return "unknown time";
  const two = (part: number) => String(part).padStart(2, "0");
  const date = `${when.getFullYear()}-${two(when.getMonth() + 1)}-${two(when.getDate())}`;
  return `${date} ${two(when.getHours())}:${two(when.getMinutes())}:${two(when.getSeconds())}`;
}

/** Hours and minutes, with the date if it differs from that of `now`. */
export function timeOfDay(iso: string, now = new Date()): string {
  const [date, time = ""] = dateTime(iso).split(" ");
  const today = dateTime(now.toISOString()).startsWith(`${date} `);
  return Number.isNaN(Date.parse(iso)) ? dateTime(iso) : `${today ? "" : `${date} `}${time.slice(0, 5)}`;
}

/** Date and time to the millisecond, for events within one second. */
export function instant(iso: string): string {
  const when = new Date(iso);
  const ms = String(when.getMilliseconds()).padStart(3, "0");
  return Number.isNaN(when.getTime()) ? dateTime(iso) : `${dateTime(iso)}.${ms}`;
}

/** Bytes in decimal units, as the settings state them: 1 GB is 10⁹ bytes. */
export function bytes(count: number | null): string {
  if (count === null) return "size unknown";
  const mega = count / 1e6;
  return mega < 1000 ? `${fixed(mega, 1)} MB` : `${fixed(mega / 1000, 1)} GB`;
}

/** Texts for names of the service: kinds and ends of runs, phases, structures of models. Pure. */

const COUNTS = ["", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine"];

/** A name within a sentence: "motor identification". */
export function spacedName(name: string): string {
  return name.replaceAll("_", " ");
}

/** A name as a heading or in a table cell: "Motor identification". */
export function heading(name: string): string {
  return capital(spacedName(name));
}

/** The text with a capital first letter; symbols retain their index: "Tuning parameter λ_q". */
export function capital(words: string): string {
  return words.charAt(0).toUpperCase() + words.slice(1);
}

/** Describes a model structure by its name on the command line: "order:4", "lags4+delay". */
export function describeStructure(name: string): string {
  const [plain = "", ...more] = name.split("+");
  const [, kind = plain, count = ""] = /^(lags|order:)(\d)$/.exec(plain) ?? [];
  const words =
    kind === "lags"
      ? `${COUNTS[Number(count)]} equal lags`
      : kind === "order:"
        ? `order ${count}, free poles`
        : `${plain} order`;
  return capital(more.length === 0 ? words : `${words}, dead time`);
}

/** Parses a typed number strictly: the whole text must be a number. Pure. */

/** A number with a decimal point or a decimal comma, without thousands separators. */
const NUMBER = /^[+-]?(\d+[.,]?\d*|[.,]\d+)(e[+-]?\d+)?$/i;

/** Number of a text; null if the text is not a number. */
export function numberIn(text: string): number | null {
  const plain = text.trim().replaceAll("−", "-");
  const number = NUMBER.test(plain) ? Number(plain.replace(",", ".")) : Number.NaN;
  return Number.isFinite(number) ? number : null;
}

/** Reason why a text is not a number. */
export function notANumber(text: string): string {
  return text.trim() === "" ? "a number is required" : `“${text.trim()}” is not a number`;
}

/**
 * Derived signals: evaluates the steps of a formula like `backend/recording/derived_signals.py`; the tests share its
 * cases. A result that is not finite is NaN, and a NaN operand gives NaN, so gaps remain gaps. Pure.
 */

export interface Step {
  readonly op: string;
  /** Number of operands from the stack. */
  readonly of: number;
  readonly value: number;
  readonly name: string;
}

export interface DerivedSignal {
  readonly name: string;
  readonly unit: string;
  readonly meaning: string;
  readonly expression: string;
  readonly signals: readonly string[];
  readonly steps: readonly Step[];
}

const MAX_DIGITS = 15;

type Operation = (...values: readonly (number | undefined)[]) => number;
const truth = (holds: boolean) => (holds ? 1 : 0);

const OPERATIONS: Readonly<Record<string, Operation>> = {
  neg: (a) => -(a as number),
  not: (a) => truth(a === 0),
  add: (a, b) => (a as number) + (b as number),
  sub: (a, b) => (a as number) - (b as number),
  mul: (a, b) => (a as number) * (b as number),
  div: (a, b) => (b === 0 ? Number.NaN : (a as number) / (b as number)),
  mod: (a, b) => remainder(a as number, b as number),
  pow: (a, b) => (a as number) ** (b as number),
  lt: (a, b) => truth((a as number) < (b as number)),
  le: (a, b) => truth((a as number) <= (b as number)),
  gt: (a, b) => truth((a as number) > (b as number)),
  ge: (a, b) => truth((a as number) >= (b as number)),
  eq: (a, b) => truth(a === b),
  ne: (a, b) => truth(a !== b),
  and: (...values) => truth(values.every((value) => value !== 0)),
  or: (...values) => truth(values.some((value) => value !== 0)),
  min: (...values) => Math.min(...(values as number[])),
  max: (...values) => Math.max(...(values as number[])),
  abs: (a) => Math.abs(a as number),
  sqrt: (a) => Math.sqrt(a as number),
  round: (a, digits = 0) => rounded(a as number, digits),
};

/** Remainder with the sign of the divisor. */
function remainder(a: number, b: number): number {
  if (b === 0) return Number.NaN;
  const left = a % b;
  return left !== 0 && left < 0 !== b < 0 ? left + b : left;
}

/** Rounds half to even. */
function rounded(a: number, digits: number): number {
  if (!Number.isInteger(digits) || Math.abs(digits) > MAX_DIGITS) return Number.NaN;
  const scale = 10 ** digits;
  const scaled = a * scale;
  const down = Math.floor(scaled);
  const half = scaled - down;
  return (half > 0.5 || (half === 0.5 && down % 2 !== 0) ? down + 1 : down) / scale;
}

/** Values of a formula; `read` returns those of a signal, `lengths` contains those of the geometry [m]. */
export function valuesOf(
  steps: readonly Step[],
  count: number,
  read: (name: string) => Float64Array,
  lengths: Readonly<Record<string, number>>,
): Float64Array {
  const stack: Float64Array[] = [];
  for (const { op, of, value, name } of steps) {
    if (op === "number") stack.push(new Float64Array(count).fill(value));
    else if (op === "signal") stack.push(read(name));
    else if (op === "length") stack.push(new Float64Array(count).fill(lengths[name] ?? Number.NaN));
    else stack.push(result(op, stack.splice(stack.length - of, of), count));
  }
  return stack[0] ?? new Float64Array(count).fill(Number.NaN);
}

function result(op: string, taken: readonly Float64Array[], count: number): Float64Array {
  const out = new Float64Array(count).fill(Number.NaN);
  const operation = OPERATIONS[op];
  const [a, b, c] = taken;
  for (let row = 0; row < count; row++) {
    if (op === "if") {
      const test = a?.[row] as number;
      if (!Number.isNaN(test)) out[row] = (test !== 0 ? b : c)?.[row] as number;
      continue;
    }
    if (operation === undefined || taken.some((one) => Number.isNaN(one[row]))) continue;
    const value =
      taken.length < 3
        ? operation(a?.[row] as number, b?.[row])
        : operation(...taken.map((one) => one[row] as number));
    if (Number.isFinite(value)) out[row] = value;
  }
  return out;
}

let known: ReadonlyMap<string, DerivedSignal> = new Map();

/** Sets the derived signals of the station. */
export function setDerived(signals: readonly DerivedSignal[]): void {
  known = new Map(signals.map((one) => [one.name, one]));
}

export function derivedSignal(name: string): DerivedSignal | undefined {
  return known.get(name);
}

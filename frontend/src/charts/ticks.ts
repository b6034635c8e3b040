/** Labels of the grid lines of an axis: whoever reads one reads where the line is. Pure. */

import { decimalsOf, fixed, MINUS } from "../samples/format";

/** Beyond so many decimals, or digits before the point, a label is written with an exponent. */
const LONGEST = 6;

/** Grid lines that are `step` apart, each with as many digits as the distance needs. */
export function tickLabels(splits: readonly (number | null)[], step: number): string[] {
  const decimals = decimalsOf(step);
  const greatest = Math.max(...splits.map((split) => Math.abs(split ?? 0)));
  if (decimals <= LONGEST && greatest < 10 ** LONGEST)
    return splits.map((split) => (split === null ? "" : fixed(split, Math.max(0, decimals))));
  return splits.map((split) => {
    if (split === null) return "";
    // what is nearer to zero than to the next line is zero, however the lines were added up
    if (Math.abs(split) < step / 2) return "0";
    const power = Math.floor(Math.log10(Math.abs(split)) + 1e-9);
    return exponential(split, Math.max(0, decimals + power));
  });
}

/** Lines of a logarithmic axis; those that the chart leaves out are null. */
export function logLabels(splits: readonly (number | null)[]): string[] {
  return splits.map((split) => {
    if (split === null) return "";
    const power = Math.floor(Math.log10(Math.abs(split)) + 1e-9);
    const exact = Number(split.toPrecision(4));
    if (power < -3 || power > 3) return exponential(exact, decimalsOf(Math.abs(exact)) + power);
    return String(exact).replace("-", MINUS);
  });
}

function exponential(value: number, digits: number): string {
  return value.toExponential(digits).replace("e+", "e").replaceAll("-", MINUS);
}

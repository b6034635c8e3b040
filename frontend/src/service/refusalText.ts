/** A refusal as one short line in the unit of the input that caused it. Pure. */

import { fixed } from "../samples/format";
import { RequestError } from "../wire/client";

/**
 * Bounds where the service gave them, in the unit shown (SI times `factor`); else the service's own sentence. The whole
 * sentence stays available to the caller as the error's message.
 */
export function refusalText(
  error: Error | null,
  factor: number,
  decimals: number,
  unit: string,
): string | null {
  if (error === null) return null;
  const problem = error instanceof RequestError ? error.problem : null;
  const { minimum, maximum, value } = problem ?? {};
  if (minimum == null || maximum == null || typeof value !== "number") return error.message;
  const shown = (quantity: number) => fixed(quantity * factor, decimals);
  return `${shown(value)} refused: outside ${shown(minimum)} … ${shown(maximum)} ${unit}`;
}

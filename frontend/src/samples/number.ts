/** What a person typed into a number box, as a number or not at all: nothing is dropped, nothing is guessed. Pure. */

const NUMBER = /^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$/i;

/** The number that the text is; null for anything else. */
export function numberIn(text: string): number | null {
  const plain = text.trim().replaceAll("−", "-");
  return NUMBER.test(plain) && Number.isFinite(Number(plain)) ? Number(plain) : null;
}

/** Why a text is not taken for a number. */
export function notANumber(text: string): string {
  return text.trim() === "" ? "needs a number" : `“${text.trim()}” is not a number`;
}

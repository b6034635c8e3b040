/** What a person typed into a number box, as a number or not at all: nothing is dropped, nothing is guessed. Pure. */

/** With a decimal point or a decimal comma; there are no separators of thousands. */
const NUMBER = /^[+-]?(\d+[.,]?\d*|[.,]\d+)(e[+-]?\d+)?$/i;

/** The number that the text is; null for anything else. */
export function numberIn(text: string): number | null {
  const plain = text.trim().replaceAll("−", "-");
  const number = NUMBER.test(plain) ? Number(plain.replace(",", ".")) : Number.NaN;
  return Number.isFinite(number) ? number : null;
}

/** Why a text is not taken for a number. */
export function notANumber(text: string): string {
  return text.trim() === "" ? "needs a number" : `“${text.trim()}” is not a number`;
}

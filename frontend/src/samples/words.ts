/** What a person reads for a name of the service: kinds and ends of runs, phases, structures of models. Pure. */

const COUNTS = ["", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine"];

/** Such a name in a sentence: "motor identification". */
export function inWordsOf(name: string): string {
  return name.replaceAll("_", " ");
}

/** Such a name as a heading or in a cell of its own: "Motor identification". */
export function heading(name: string): string {
  return capital(inWordsOf(name));
}

/** Words as they stand, with a capital; a symbol in them keeps its index: "Tuning parameter λ_q". */
export function capital(words: string): string {
  return words.charAt(0).toUpperCase() + words.slice(1);
}

/** A number of things as it is said: "1 day", "30 days". */
export function counted(count: number, noun: string): string {
  return `${count} ${noun}${count === 1 ? "" : "s"}`;
}

/** A structure of a model by its name at the command line: "order:4", "lags4+delay". */
export function structureInWords(name: string): string {
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

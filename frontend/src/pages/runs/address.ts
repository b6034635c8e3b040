/** Addresses of runs on the page. Pure. */

/** A run by itself, or beside others. */
export function addressOf(run: number, others: readonly number[] = []): string {
  return others.length === 0 ? `/runs/${run}` : `/runs/${run}/${others.join(",")}`;
}

/** The numbers of an address, each once and without the run itself. */
export function othersIn(text: string | undefined, run: number): number[] {
  const numbers = (text ?? "").split(",").filter((part) => part !== "");
  return [...new Set(numbers.map(Number))].filter((number) => number !== run);
}

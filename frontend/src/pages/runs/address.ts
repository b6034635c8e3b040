/** Addresses of runs on the page. Pure. */

/** All runs, their metrics, a run, a run at a second of it, a run beside others, whatever these are: `othersIn` says what is wrong with them. */
export const RUNS =
  /^\/runs(?:\/(?:(?<chart>metrics)|(?<id>\d+)(?:@(?<at>\d+(?:\.\d+)?))?(?:\/(?<others>[^/]+)(?:\/(?<how>[^/]+))?)?))?$/;

/** All experiments, one that was run, one to be made of a run. */
export const EXPERIMENTS = /^\/experiments(?:\/(?:(?<id>\d+)|as-run\/(?<asRun>\d+)))?$/;

/** Where a run is made an experiment. */
export function experimentOf(run: number): string {
  return `/experiments/as-run/${run}`;
}

/** A run by itself, at a second of its recording where one is given, or beside others, compared as `how` says. */
export function addressOf(
  run: number,
  others: readonly number[] = [],
  at_s: number | null = null,
  how = "",
): string {
  const own = at_s === null ? `/runs/${run}` : `/runs/${run}@${Math.max(0, at_s).toFixed(3)}`;
  if (others.length === 0) return own;
  return `${own}/${others.join(",")}${how === "" ? "" : `/${how}`}`;
}

/** As many as the service sets beside each other. */
export const MOST_COMPARED = 20;

export interface Others {
  readonly numbers: readonly number[];
  /** What of the address is left out, and why; "" where nothing is. */
  readonly problem: string;
}

/** The runs beside a run in its address, each once and without the run itself. */
export function othersIn(text: string | undefined, run: number): Others {
  const parts = (text ?? "").split(",").filter((part) => part !== "");
  const strange = parts.filter((part) => !isNumber(part));
  const named = [...new Set(parts.filter(isNumber).map(Number))].filter((number) => number !== run);
  const more = named.slice(MOST_COMPARED - 1);
  const problems = [
    strange.length > 0 && `the address has ${strange.join(", ")}, which is no number of a run`,
    more.length > 0 &&
      `at most ${MOST_COMPARED} runs are compared, and the address names ${named.length + 1}: left out are ${more.join(", ")}`,
  ];
  return {
    numbers: named.slice(0, MOST_COMPARED - 1),
    problem: problems.filter((problem) => problem !== false).join("; "),
  };
}

function isNumber(part: string): boolean {
  return /^[1-9]\d*$/.test(part) && Number.isSafeInteger(Number(part));
}

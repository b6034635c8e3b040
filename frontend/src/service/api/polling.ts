/** How often the page asks again for what may change, and whether a run is still going. */

/** How often the page asks again for what another person may change and the state does not tell [ms]. */
export const OTHERS_MS = 3000;
export const WHILE_RUNNING_MS = 700;

/** End states of the service, beside which a run is still going. */
export function isRunning(status: string): boolean {
  return status === "running";
}

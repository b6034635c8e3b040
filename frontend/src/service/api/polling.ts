/** Polling intervals of the page, and the test whether a run continues. */

/** Interval for data that another person may change and that the state does not report [ms]. */
export const OTHERS_MS = 3000;
export const WHILE_RUNNING_MS = 700;

/** Whether a run continues, by the end state that the service reports. */
export function isRunning(status: string): boolean {
  return status === "running";
}

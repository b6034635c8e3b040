/** What has happened since the page was opened, by what the service tells of its state. Pure. */

import type { Fault, State, Task } from "../wire/types";

export interface Trip {
  readonly kind: "trip";
  readonly fault: Fault;
  /** Which start of the loop the fault's tick counts from. */
  readonly starts: number;
}

export type Happening = Trip | { readonly kind: "over"; readonly run: Task["run"] };

export class Happenings {
  private before: State | null = null;
  /** The run whose end was told last: in the pause behind it it is over, and stays what the state names. */
  private over: Task["run"] | null = null;

  /** What is new in a state; nothing in the first one, which is of before, and nothing of what a recording plays. */
  heard(state: State): Happening[] {
    const { before } = this;
    this.before = state;
    if (before === null) this.over = isPaused(state.task) ? state.task.run : null;
    if (before === null || state.plant.kind === "replay") return [];
    const found: Happening[] = [];
    if (state.fault !== null && !state.fault.expected && !isSame(before, state)) {
      found.push({ kind: "trip", fault: state.fault, starts: state.link.starts });
    }
    const run = before.task?.run ?? null;
    if (run !== null && run !== this.over && (run !== state.task?.run || isPaused(state.task))) {
      found.push({ kind: "over", run });
      this.over = run;
    }
    return found;
  }
}

function isPaused(task: Task | null): task is Task {
  return task?.phase === "paused";
}

function isSame(before: State, state: State): boolean {
  return before.link.starts === state.link.starts && before.fault?.tick === state.fault?.tick;
}

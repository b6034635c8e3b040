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

  /** What is new in a state; nothing in the first one, which is of before, and nothing of what a recording plays. */
  heard(state: State): Happening[] {
    const { before } = this;
    this.before = state;
    if (before === null || state.plant.kind === "replay") return [];
    const found: Happening[] = [];
    if (state.fault !== null && !isSame(before, state)) {
      found.push({ kind: "trip", fault: state.fault, starts: state.link.starts });
    }
    if (before.task !== null && before.task.run !== state.task?.run) {
      found.push({ kind: "over", run: before.task.run });
    }
    return found;
  }
}

function isSame(before: State, state: State): boolean {
  return before.link.starts === state.link.starts && before.fault?.tick === state.fault?.tick;
}

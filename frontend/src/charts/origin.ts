/** What a picture of the charts says of itself: run, plant, tuning and time. Pure but for the clock. */

import { dateTime, short } from "../samples/format";
import { statistics } from "../samples/statistics";
import type { Stretch } from "../samples/stretch";
import { drawnNow } from "./Planes";
import type { Plane } from "./plane";
import type { Sheet } from "./sheet";
import type { PlotSource } from "./source";
import { timeText } from "./timeAxis";

export interface Origin {
  /** "run 12", or what else is drawn. */
  readonly of: string;
  /** SIM, RIG, or another word for what moved; "" for what lies between runs, which has no tuning either. */
  readonly plant: string;
  readonly bank: string;
}

const TUNING = { lam_q: "λ_q", lam_S: "λ_S" } as const;

interface Drawn extends Omit<Sheet, "planes" | "foot"> {
  readonly planes: readonly Plane[];
  readonly looked_s: number;
}

/** All that is on a sheet of what is drawn now. */
export function sheetNow({ planes, looked_s, ...drawn }: Drawn, { of, plant, bank }: Origin): Sheet {
  const { source, hidden, seen, epoch_s } = drawn;
  const [from, to] = [seen.from_s, seen.to_s].map((time_s) => timeText(time_s, 0.001, epoch_s));
  const of_day = epoch_s === null ? " since the start" : "";
  return {
    ...drawn,
    planes: planes.map((plane) => ({ plane, drawn: drawnNow(plane, source, hidden, seen, looked_s, null) })),
    foot: [
      [of, plant, ...(plant === "" ? [] : lambdas(source, seen)), bank]
        .filter((part) => part !== "")
        .join(" · "),
      `${from} to ${to}${of_day} · saved ${dateTime(new Date().toISOString())}`,
    ],
  };
}

/** λ as the samples in sight have it: two numbers where it was changed meanwhile. */
function lambdas(source: PlotSource, seen: Stretch): string[] {
  const { t, raw, columns } = source.table(Object.keys(TUNING), seen);
  return Object.entries(TUNING).map(([name, symbol]) => {
    const column = columns.find((one) => one.name === name);
    if (column === undefined) return `${symbol} not recorded`;
    const { minimum, maximum } = statistics(column, t, raw);
    if (Number.isNaN(minimum)) return `${symbol} not in force`;
    return `${symbol} ${minimum === maximum ? short(minimum) : `${short(minimum)} to ${short(maximum)}`} s`;
  });
}

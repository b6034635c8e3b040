/** Statistics of what is in sight, or between the cursors: from the page's own samples, or computed by the service. */

import { useEffect, useRef, useState } from "react";
import { type Figures, figuresOf } from "../samples/figures";
import type { Stretch } from "../samples/stretch";
import type { SampleTable } from "../samples/table";
import type { StoredData } from "./stored";

const EVERY_MS = 500;
/** How often it is looked whether the range has changed, and has come to rest since. */
const LOOK_MS = 200;

export interface ShownStatistics {
  /** Null before the first ones are there. */
  readonly figures: Figures | null;
  /** How far those of the range asked for now are, 0 to 1; null where they are there. */
  readonly share: number | null;
  /** Why there are none, "" where there are. */
  readonly problem: string;
}

interface Asked {
  readonly names: readonly string[];
  /** The stretch in sight, or between the cursors. */
  range(): Stretch;
  table(): SampleTable;
}

/** `asked` and `stored` have to be the same objects as long as they say the same. */
export function useStatistics({ names, range, table }: Asked, stored: StoredData | null): ShownStatistics {
  const [shown, setShown] = useState<ShownStatistics>({ figures: null, share: null, problem: "" });
  const latest = useRef({ range, table });
  latest.current = { range, table };
  useEffect(() => {
    if (stored === null) {
      const renew = () => setShown({ figures: figuresOf(latest.current.table()), share: null, problem: "" });
      renew();
      const timer = window.setInterval(renew, EVERY_MS);
      return () => window.clearInterval(timer);
    }
    let [seen, asked] = ["", ""];
    let leave = new AbortController();
    const look = () => {
      const now = latest.current.range();
      const key = `${now.from_s} ${now.to_s}`;
      const rested = key === seen || asked === "";
      seen = key;
      if (key === asked || !rested) return;
      asked = key;
      leave.abort();
      leave = new AbortController();
      const { signal } = leave;
      const tell = (told: Partial<ShownStatistics>) => {
        if (!signal.aborted) setShown((before) => ({ ...before, problem: "", ...told }));
      };
      tell({ share: 0 });
      stored
        .statistics(names, now, { signal, onShare: (share) => tell({ share }) })
        .then((figures) => tell({ figures, share: null }))
        .catch((error: Error) => tell({ figures: null, share: null, problem: error.message }));
    };
    look();
    const timer = window.setInterval(look, LOOK_MS);
    return () => {
      window.clearInterval(timer);
      leave.abort();
    };
  }, [names, stored]);
  return shown;
}

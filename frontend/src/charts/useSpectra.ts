/** Spectra of a range: of the page's own samples at once, or computed by the service, which takes a moment. */

import { useEffect, useState } from "react";
import { type Spectra, spectraOf } from "../samples/figures";
import type { Stretch } from "../samples/stretch";
import type { SampleTable } from "../samples/table";
import { PERIOD_S } from "../wire/sample.gen";
import type { StoredData } from "./stored";

/** What the spectrum is to be of: what was in sight, or between the cursors, when it was asked for. */
export interface SpectrumOrder {
  readonly range: Stretch;
  /** Null where the service has every sample. */
  readonly table: SampleTable | null;
  readonly stored: StoredData | null;
}

export interface ShownSpectra {
  readonly spectra: Spectra | null;
  readonly share: number;
  readonly problem: string;
}

const NOTHING: ShownSpectra = { spectra: null, share: 0, problem: "" };

/** `names` has to be the same array as long as it says the same. What is under way ends when nobody shows it any more. */
export function useSpectra({ range, table, stored }: SpectrumOrder, names: readonly string[]): ShownSpectra {
  const [shown, setShown] = useState(NOTHING);
  useEffect(() => {
    if (table !== null) {
      setShown({ ...NOTHING, spectra: spectraOf(table, names, PERIOD_S) });
      return;
    }
    if (stored === null) return;
    const leave = new AbortController();
    const tell = (told: Partial<ShownSpectra>) => {
      if (!leave.signal.aborted) setShown((before) => ({ ...before, ...told }));
    };
    setShown(NOTHING);
    stored
      .spectra(names, range, { signal: leave.signal, onShare: (share) => tell({ share }) })
      .then((spectra) => tell({ spectra, share: 1 }))
      .catch((error: Error) => tell({ problem: error.message }));
    return () => leave.abort();
  }, [range, table, stored, names]);
  return shown;
}

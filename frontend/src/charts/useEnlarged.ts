/** One panel over time shown alone: by its button, by Enter in its chart; Escape shows all again. */

import { useHotkeys } from "@mantine/hooks";
import { useMemo, useState } from "react";
import type { Panel } from "../theme/signals";

interface Enlarged {
  /** What is to be drawn: all panels, or the one that is enlarged. */
  readonly panels: readonly Panel[];
  /** Title of the panel that is shown alone, null while all are shown. */
  readonly enlarged: string | null;
  /** Show the panel alone, or all where it is alone already. */
  enlarge(title: string): void;
}

export function useEnlarged(all: readonly Panel[]): Enlarged {
  const [wanted, setWanted] = useState<string | null>(null);
  const alone = useMemo(
    () => all.filter((panel) => panel.title === wanted && panel.over === undefined),
    [all, wanted],
  );
  const isAlone = alone.length > 0;
  useHotkeys([["Escape", () => setWanted(null), { preventDefault: isAlone }]]);
  return {
    panels: isAlone ? alone : all,
    enlarged: isAlone ? wanted : null,
    enlarge: (title) => setWanted(wanted === title ? null : title),
  };
}

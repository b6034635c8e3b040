/** Colours of what the charts draw beside the curves, read from the theme's variables. */

import { variableOf } from "../theme/signals";

export interface ChartColours {
  grid: string;
  axis: string;
  limit: string;
  text: string;
  fault: string;
  panel: string;
  accent: string;
  accentSoft: string;
  /** A hue as this theme draws it. */
  drawn(hue: string): string;
}

export function readColours(element: Element): ChartColours {
  const style = getComputedStyle(element);
  const variable = (name: string) => style.getPropertyValue(name).trim();
  const asked = new Map<string, string>(); // to ask the style anew for each frame would have it computed anew
  const drawn = (hue: string) => {
    const known = asked.get(hue) ?? (variable(variableOf(hue)) || hue);
    asked.set(hue, known);
    return known;
  };
  return {
    grid: variable("--chart-grid"),
    axis: variable("--chart-axis"),
    limit: variable("--chart-limit"),
    text: variable("--text"),
    fault: variable("--fault"),
    panel: variable("--panel"),
    accent: variable("--accent"),
    accentSoft: variable("--accent-soft"),
    drawn,
  };
}

/** Mantine names what describes its own inputs; here another element is named, for as long as there is one. */

import { type RefObject, useEffect } from "react";

export function useDescribedBy(input: RefObject<HTMLElement | null>, id: string | undefined): void {
  useEffect(() => {
    const element = input.current;
    if (id === undefined || element === null) return;
    const before = element.getAttribute("aria-describedby");
    element.setAttribute("aria-describedby", [before, id].filter(Boolean).join(" "));
    return () => {
      if (before === null) element.removeAttribute("aria-describedby");
      else element.setAttribute("aria-describedby", before);
    };
  }, [input, id]);
}

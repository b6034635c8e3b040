/** The preview of a text that is being edited: asked for when it comes to rest, told from one of an earlier text. */

import { keepPreviousData, useQuery } from "@tanstack/react-query";
import { useEffect, useState } from "react";
import { useLive } from "../../live/react";
import { composedPreviewQuery } from "../../service/queries";
import type { CheckedExperiment } from "../../wire/types";

const REST_MS = 600;

interface ComposedPreview {
  /** The newest there is, be it of an earlier text. */
  readonly checked: CheckedExperiment | null;
  /** It is of this very text, and was played. */
  readonly current: boolean;
  /** Why this text is refused; null while that is not known. */
  readonly error: Error | null;
}

/** No text, no preview. */
export function useComposedPreview(text: string): ComposedPreview {
  const [rested, setRested] = useState(text);
  // peaks are those of the tuning in force: of another one they are to be played anew
  const tuning = useLive(({ state }) => {
    if (state === null) return "";
    const { lam_q, lam_S, lam_motor, b, interpolate, u_plan, k_ext, bank } = state.tuning;
    return JSON.stringify([lam_q, lam_S, lam_motor, b, interpolate, u_plan, k_ext, bank?.id]);
  });
  useEffect(() => {
    const timer = setTimeout(() => setRested(text), REST_MS);
    return () => clearTimeout(timer);
  }, [text]);
  const asked = rested === text ? rested : "";
  const { data, error, isPlaceholderData } = useQuery({
    ...composedPreviewQuery(asked, tuning),
    enabled: asked !== "",
    placeholderData: keepPreviousData,
  });
  return {
    checked: text === "" ? null : (data ?? null),
    current: asked !== "" && data !== undefined && !isPlaceholderData && !data.busy,
    error: asked === "" ? null : error,
  };
}

/**
 * The preview of a text that is being edited: asked for when it comes to rest, told from one of an earlier text. What is
 * refused is told at once, whatever is being played meanwhile. One is played at a time, and to its end: ending it would end the process that plays, which takes far longer to be there again.
 * After it comes the text that stands there then, whatever stood there in between.
 */

import { keepPreviousData, useQuery } from "@tanstack/react-query";
import { useEffect, useState } from "react";
import { useLive } from "../../live/react";
import { composedPreviewQuery, lookedOverQuery } from "../../service/ownExperiments";
import type { CheckedExperiment } from "../../wire/types";

const REST_MS = 600;
const LOOK_MS = 300;

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
  // peaks are those of the tuning in force: of another one they are to be played anew
  const tuning = useLive(({ state }) => {
    if (state === null) return "";
    const { lam_q, lam_S, lam_motor, b, interpolate, motion, u_plan, k_ext, bank } = state.tuning;
    return JSON.stringify([lam_q, lam_S, lam_motor, b, interpolate, motion, u_plan, k_ext, bank?.id]);
  });
  const [asked, ask] = useState({ text: "", tuning });
  const { data, error, isFetching, isPlaceholderData } = useQuery({
    ...composedPreviewQuery(asked.text, asked.tuning),
    enabled: asked.text !== "",
    placeholderData: keepPreviousData,
  });
  const [rested, rest] = useState("");
  useEffect(() => {
    const timer = setTimeout(() => rest(text), LOOK_MS);
    return () => clearTimeout(timer);
  }, [text]);
  const looked = useQuery({ ...lookedOverQuery(rested), enabled: rested !== "" });
  const refused = rested === text ? looked.error : null;
  const standing = asked.text === text && asked.tuning === tuning;
  useEffect(() => {
    if (isFetching || standing) return;
    const timer = setTimeout(() => ask({ text, tuning }), REST_MS);
    return () => clearTimeout(timer);
  }, [text, tuning, isFetching, standing]);
  return {
    checked: text === "" ? null : (data ?? null),
    current:
      text !== "" && standing && refused === null && data !== undefined && !isPlaceholderData && !data.busy,
    error: text === "" ? null : (refused ?? (standing ? error : null)),
  };
}

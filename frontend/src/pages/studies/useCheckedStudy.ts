/** What a text of a study says, read by the service once the text has come to rest. */

import { useQuery } from "@tanstack/react-query";
import { useEffect, useState } from "react";
import { checkedStudyQuery } from "../../service/studies";
import type { CheckedStudy } from "../../wire/types";

const REST_MS = 400;

/** Of this very text; null while that is not known, and for no text. */
export function useCheckedStudy(text: string): CheckedStudy | null {
  const [rested, rest] = useState(text);
  useEffect(() => {
    const timer = setTimeout(() => rest(text), REST_MS);
    return () => clearTimeout(timer);
  }, [text]);
  const { data } = useQuery({ ...checkedStudyQuery(rested), enabled: rested.trim() !== "" });
  return rested === text && data !== undefined ? data : null;
}

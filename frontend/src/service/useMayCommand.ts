/** Whether the signed-in person may change anything: a viewer looks on, and may press STOP. */

import { useQuery } from "@tanstack/react-query";
import { sessionQuery } from "./queries";

/** Null while it is not known yet. */
export function useMayCommand(): boolean | null {
  const { data } = useQuery(sessionQuery);
  return data === undefined ? null : data.role === "operator";
}

/** Entries of the bank in use as points of the plane: where each was identified. */

import { useQuery } from "@tanstack/react-query";
import { useMemo } from "react";
import { useLive } from "../../live/react";
import { banksQuery } from "../../service/queries";
import type { PlaneEntry } from "./paintPlane";

const NONE: readonly PlaneEntry[] = [];

export function useBankEntries(): readonly PlaneEntry[] {
  const bank = useLive((live) => live.state?.tuning.bank?.id);
  const { data } = useQuery(banksQuery);
  return useMemo(() => {
    const entries = data?.find(({ id }) => id === bank)?.entries;
    return entries?.map(({ S_nominal, q_nominal }) => ({ S: S_nominal, q: q_nominal })) ?? NONE;
  }, [data, bank]);
}

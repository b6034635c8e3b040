/** Reads, writes and removes the derived signals of the station. */

import { queryOptions, useMutation, useQuery, useQueryClient } from "@tanstack/react-query";
import { useEffect } from "react";
import { useLiveStore } from "../../live/react";
import { type DerivedSignal, setDerived } from "../../samples/formula";
import { answered, api } from "../../wire/client";
import type { Formula, FormulaText } from "../../wire/types";

/** Interval at which the page fetches the signals that other people have written [ms]. */
const AGAIN_MS = 30_000;
const NONE: readonly Formula[] = [];

const formulasQuery = queryOptions({
  queryKey: ["formulas"],
  queryFn: async () => {
    const { formulas } = await answered(api.GET("/api/formulas"));
    setDerived(formulas); // before the components that wait for them render
    return formulas;
  },
  refetchInterval: AGAIN_MS,
});

export function useDerived(): readonly DerivedSignal[] {
  return useQuery(formulasQuery).data ?? NONE;
}

/** Adds the derived signals to the live window. */
export function useLiveFormulas(): void {
  const store = useLiveStore();
  const derived = useDerived();
  useEffect(() => store.setFormulas(derived), [store, derived]);
}

export function useFormulas(): readonly Formula[] {
  return useQuery(formulasQuery).data ?? NONE;
}

export function useSaveFormula() {
  const renew = useRenew();
  return useMutation({
    mutationFn: ({ name, ...body }: FormulaText & { name: string }) =>
      answered(api.PUT("/api/formulas/{name}", { params: { path: { name } }, body })),
    onSuccess: renew,
  });
}

export function useRemoveFormula() {
  const renew = useRenew();
  return useMutation({
    mutationFn: (name: string) =>
      answered(api.DELETE("/api/formulas/{name}", { params: { path: { name } } })),
    onSuccess: renew,
  });
}

/** Returns a function that fetches the formulas again, and the samples of recordings computed with earlier ones. */
function useRenew(): () => Promise<void> {
  const queries = useQueryClient();
  return async () => {
    await queries.invalidateQueries({ queryKey: formulasQuery.queryKey });
    await queries.invalidateQueries({
      predicate: ({ queryKey }) => queryKey[0] === "runs" && queryKey[2] === "samples",
    });
  };
}

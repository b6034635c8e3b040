/** Searches under names: chosen, kept, taken off the list. */

import { Button, NativeSelect, TextInput } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useState } from "react";
import { OperatorsOnly } from "../../components/OperatorsOnly";
import { Refusal } from "../../components/Refusal";
import { useForgetSearch, useSaveSearch } from "../../service/commands";
import { savedSearchesQuery } from "../../service/queries";
import page from "../Page.module.css";
import { type Filters, NO_FILTERS, together } from "./filters";
import styles from "./Runs.module.css";

interface SavedSearchesProps {
  readonly typed: string;
  readonly filters: Filters;
  onChoose(text: string): void;
  onFilter(filters: Filters): void;
}

export function SavedSearches({ typed, filters, onChoose, onFilter }: SavedSearchesProps) {
  const { data: saved = [] } = useQuery(savedSearchesQuery);
  const [name, setName] = useState("");
  const save = useSaveSearch();
  const forget = useForgetSearch();
  const asked = together(typed, filters);
  const chosen = saved.find((search) => search.where === asked)?.name ?? "";
  return (
    <div className={`${page.actions} ${styles.saved}`}>
      <NativeSelect
        aria-label="Saved searches"
        value={chosen}
        disabled={saved.length === 0}
        data={[
          { value: "", label: saved.length === 0 ? "No saved searches" : "Saved searches …" },
          ...saved.map((search) => ({ value: search.name, label: search.name })),
        ]}
        onChange={(event) => {
          const found = saved.find((search) => search.name === event.currentTarget.value);
          if (found === undefined) return;
          onFilter(NO_FILTERS);
          onChoose(found.where);
        }}
      />
      <OperatorsOnly>
        {chosen !== "" && (
          <Button variant="default" loading={forget.isPending} onClick={() => forget.mutate(chosen)}>
            Forget search
          </Button>
        )}
        <TextInput
          aria-label="Name of the search"
          placeholder="Name"
          value={name}
          w={150}
          onChange={(event) => setName(event.currentTarget.value)}
        />
        <Button
          variant="default"
          disabled={asked === "" || name.trim() === ""}
          loading={save.isPending}
          onClick={() => save.mutate({ name: name.trim(), where: asked }, { onSuccess: () => setName("") })}
        >
          Save search
        </Button>
      </OperatorsOnly>
      <Refusal error={save.error ?? forget.error} about={asked + name} />
    </div>
  );
}

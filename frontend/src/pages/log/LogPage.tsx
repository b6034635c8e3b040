/** Everything that happened here: who did what, when, and where it stands in a recording. */

import { Button, NativeSelect, TextInput } from "@mantine/core";
import { useDebouncedValue } from "@mantine/hooks";
import { useInfiniteQuery } from "@tanstack/react-query";
import { useMemo, useState } from "react";
import { TbSearch } from "react-icons/tb";
import { Card } from "../../components/Card";
import { type LogAsked, logQuery } from "../../service/log";
import page from "../Page.module.css";
import { CHOICES, kindsOf, midnight } from "./kinds";
import styles from "./Log.module.css";
import { LogRows } from "./LogRows";

interface Filters {
  readonly words: string;
  readonly choice: string;
  readonly from: string;
  readonly to: string;
}

const NONE: Filters = { words: "", choice: "", from: "", to: "" };

export default function LogPage() {
  const [filters, setFilters] = useState<Filters>(NONE);
  const [asked] = useDebouncedValue(filters, 250);
  const log = useInfiniteQuery(
    logQuery(
      useMemo<LogAsked>(
        () => ({
          kinds: kindsOf(asked.choice),
          words: asked.words.trim(),
          since: midnight(asked.from),
          before: midnight(asked.to, 1),
        }),
        [asked],
      ),
    ),
  );
  const entries = log.data?.pages.flatMap((one) => one.entries) ?? [];
  const narrowed = Object.values(asked).some((value) => value !== "");
  return (
    <div className={page.page}>
      <h1 className={page.title}>Log</h1>
      <Card title="Entries">
        <LogSearch filters={filters} onFilter={setFilters} />
        {log.error && <p role="alert">{log.error.message}</p>}
        {log.data === undefined && !log.error && <p className={page.empty}>Loading …</p>}
        {log.data !== undefined && entries.length === 0 && (
          <p className={page.empty}>{narrowed ? "Nothing like that happened." : "Nothing happened yet."}</p>
        )}
        {entries.length > 0 && <LogRows entries={entries} />}
      </Card>
      <div className={page.actions}>
        <Button
          variant="default"
          disabled={!log.hasNextPage}
          loading={log.isFetchingNextPage}
          onClick={() => void log.fetchNextPage()}
        >
          Older
        </Button>
        <span className={page.dim}>
          {entries.length === 0 ? "none" : `the newest ${entries.length}`}
          {log.hasNextPage ? ", there are more" : ""}
        </span>
      </div>
    </div>
  );
}

function LogSearch({ filters, onFilter }: { filters: Filters; onFilter: (filters: Filters) => void }) {
  const set = (part: Partial<Filters>) => onFilter({ ...filters, ...part });
  return (
    <search className={styles.filters} aria-label="Search and filters">
      <TextInput
        className={styles.box ?? ""}
        type="search"
        label="Search"
        aria-label="Search the log"
        placeholder="words, a person, a tag"
        maxLength={400}
        leftSection={<TbSearch size={14} />}
        value={filters.words}
        onChange={(event) => set({ words: event.currentTarget.value })}
      />
      <NativeSelect
        label="Show"
        data={CHOICES}
        value={filters.choice}
        onChange={(event) => set({ choice: event.currentTarget.value })}
      />
      <TextInput
        type="date"
        label="From"
        value={filters.from}
        onChange={(event) => set({ from: event.currentTarget.value })}
      />
      <TextInput
        type="date"
        label="To"
        value={filters.to}
        onChange={(event) => set({ to: event.currentTarget.value })}
      />
      <Button
        variant="default"
        disabled={Object.values(filters).every((value) => value === "")}
        onClick={() => onFilter(NONE)}
      >
        Clear
      </Button>
    </search>
  );
}

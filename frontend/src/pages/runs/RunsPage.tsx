/** Everything that was recorded: search, look, take home. */

import { useParams } from "wouter";
import { RunDetail } from "./RunDetail";
import { RunTable } from "./RunTable";

export default function RunsPage() {
  const { id, other } = useParams();
  return id === undefined ? (
    <RunTable />
  ) : (
    <RunDetail key={id} id={Number(id)} other={other === undefined ? undefined : Number(other)} />
  );
}

export default function BanksPage() {
  return <h1>BanksPage</h1>;
}
